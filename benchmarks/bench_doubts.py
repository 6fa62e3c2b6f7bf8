"""How often sound cars are doubted: hours of simulated driving, and the recorded car.

    python benchmarks/bench_doubts.py                 100 hidden cars, 10 h, 2 processes
    python benchmarks/bench_doubts.py --cars 3 --seconds 5
    python benchmarks/bench_doubts.py --recordings FOLDER
"""

from __future__ import annotations

import argparse
import random
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from math import pi, sin
from pathlib import Path
from typing import Any

from recorded_frames import FRAME, drives_of, states_of

from dart_hal.car import Car
from dart_hal.core.config import parse_car
from dart_hal.core.process.jobs import each
from dart_hal.core.types import Doubt
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.dart import read
from dart_lab.sim.car_file import typical_car_toml
from dart_lab.sim.motion import MeanMotion
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import World

IGNORED_DOUBTS = frozenset({Doubt.DIRECTION_UNSURE.value})
"""Reported of sound cars as well: one encoder has no sign."""
SLOPE = 0.04 * 9.81
"""m/s2 along a floor of 4 %."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Seconds looked at, and the doubts: (who, name, first s, seconds)."""

    seconds: float
    doubts: tuple[tuple[str, str, float, float], ...]


class Hand:
    """What a floor or a hand does to the car: a push [m/s2], or it is held."""

    def __init__(self, world: World, tick: float) -> None:
        self.push, self.held = 0.0, False
        self._inner, self._motion, self._dt = world.motion.step, world.motion, tick
        world.motion.step = self._step  # type: ignore[method-assign]

    def _step(self, throttle: float, brake: float, angle: float) -> MeanMotion:
        inertial, motion = self._inner(throttle, brake, angle), self._motion
        if self.held:
            motion.v_x = motion.v_y = motion.omega = 0.0
            return MeanMotion(0.0, 0.0, 0.0, 0.0, 0.0)
        motion.v_x += self.push * self._dt
        return inertial._replace(a_x=inertial.a_x + self.push)


@dataclass(slots=True)
class Driver:
    """What a style of driving has at hand."""

    car: Car
    hand: Hand
    rng: random.Random
    held: Any = None

    def every(self, t: float, period: float, draw: Callable[[], Any]) -> Any:
        """A value drawn again each ``period`` s."""
        number = int(t / period)
        if self.held is None or self.held[0] != number:
            self.held = (number, draw())
        return self.held[1]


def calm(d: Driver, t: float) -> None:
    v, s = d.every(t, 2.0, lambda: (d.rng.uniform(0.3, 1.5), d.rng.uniform(-0.25, 0.25)))
    d.car.drive_speed(steering=s, speed=v)


def creeping(d: Driver, t: float) -> None:
    v, s = d.every(t, 3.0, lambda: (d.rng.uniform(0.1, 0.3), d.rng.uniform(-0.35, 0.35)))
    d.car.drive_speed(steering=s, speed=v)


def hard(d: Driver, t: float) -> None:
    """Full throttle, coasting, the brake."""
    top, s = d.every(t, 3.0, lambda: (d.rng.uniform(0.4, 1.0), d.rng.uniform(-0.1, 0.1)))
    part = t % 3.0
    d.car.drive(steering=s, throttle=top if part < 1.2 else 0.0 if part < 1.8 else -0.5)


def backwards(d: Driver, t: float) -> None:
    """Forward, rest, reverse, rest."""
    v = d.every(t, 3.0, lambda: d.rng.uniform(0.3, 0.9))
    part = int(t % 12.0 / 3.0)
    d.car.drive_speed(steering=0.2 * sin(t), speed=(v, 0.0, -v, 0.0)[part])


def grip(d: Driver, t: float) -> None:
    """Circles at the end of the tyres."""
    tau, s = d.every(t, 6.0, lambda: (d.rng.uniform(0.25, 0.45),
                                      d.rng.choice((-1, 1)) * d.rng.uniform(0.2, 0.35)))
    d.car.drive(steering=s, throttle=tau)


def sloping(d: Driver, t: float) -> None:
    d.hand.push = SLOPE * sin(2 * pi * t / 20.0)
    calm(d, t)


def wall(d: Driver, t: float) -> None:
    """A bumper at a wall, just above the dead band; free again, against it again."""
    d.hand.held = t % 6.0 > 2.0
    d.car.drive(steering=0.1, throttle=d.every(t, 6.0, lambda: d.rng.uniform(0.18, 0.23))
                if d.hand.held else 0.0)


def pushed(d: Driver, t: float) -> None:
    """Moved to and fro by hand, with rests; no command."""
    d.hand.push = (3.0, -3.0, 0.0, -2.0, 2.0, 0.0)[int(t % 6.0)]


def slalom(d: Driver, t: float) -> None:
    v = d.every(t, 6.0, lambda: d.rng.uniform(0.8, 1.8))
    d.car.drive_speed(steering=0.2 * sin(2 * pi * t), speed=v)


def anyhow(d: Driver, t: float) -> None:
    tau, s = d.every(t, 0.7, lambda: (d.rng.uniform(-0.3, 0.5), d.rng.uniform(-0.35, 0.35)))
    d.car.drive(steering=s, throttle=tau)


STYLES: dict[str, tuple[Callable[[Driver, float], None], str]] = {
    "calm": (calm, "kinematic&tick=10"), "creeping": (creeping, "kinematic&tick=10"),
    "hard": (hard, "dynamic"), "backwards": (backwards, "kinematic&tick=10"),
    "grip": (grip, "dynamic"), "sloping": (sloping, "kinematic&tick=10"),
    "wall": (wall, "kinematic&tick=10"), "pushed": (pushed, "kinematic&tick=10"),
    "slalom": (slalom, "dynamic"), "anyhow": (anyhow, "dynamic")}
"""Way of driving, and the model whose physics it needs."""


def drive(case: tuple[int, str], seconds: float) -> Outcome:
    """One hidden car in one style."""
    seed, style = case
    act, model = STYLES[style]
    backend = open_backend(f"sim://?nano=mock&seed={seed}&model={model}")
    counts: Counter[str] = Counter()
    first: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as cars, Car.over(backend, cars=cars) as car:
        hand = Hand(world_of(backend), 0.01 if "tick" in model else 0.001)
        driver = Driver(car, hand, random.Random(f"{seed} {style}"))
        if style != "pushed":
            car.arm(waive=["CALIBRATION_MISSING"])
        start = None
        for state in car.states(duration=seconds):
            start = state.t if start is None else start
            act(driver, state.t - start)
            doubts = state.health.doubts - IGNORED_DOUBTS
            counts.update(doubts)
            for name in doubts:
                first.setdefault(name, state.t - start)
    return Outcome(seconds, tuple((f"sim-{seed} {style}", n, round(first[n], 2), k * FRAME)
                                  for n, k in counts.items()))


def recorded(path: Path) -> Outcome:
    """One recording of the real car."""
    files = parse_car(typical_car_toml(), "sim://", None)
    seconds, counts, first, name = 0.0, Counter[str](), dict[str, float](), path.name
    for part in drives_of(read(path)):
        name = part.name
        for k, state in enumerate(states_of(part, files)):
            doubts = state.health.doubts - IGNORED_DOUBTS
            counts.update(doubts)
            for doubt in doubts:
                first.setdefault(doubt, seconds + k * FRAME - 2.0)
        seconds += len(part) * FRAME
    return Outcome(seconds, tuple((name, n, round(first[n], 2), k * FRAME)
                                  for n, k in counts.items()))


def show(outcomes: Iterator[Outcome]) -> int:
    """Print every doubt and the sum; number of drives that were doubted."""
    seconds, doubted = 0.0, 0
    for outcome in outcomes:
        seconds += outcome.seconds
        doubted += bool(outcome.doubts)
        for who, name, first, lasting in outcome.doubts:
            print(f"{who}: {name} from {first:.2f} s on, {lasting:.2f} s in all", flush=True)
    print(f"{seconds / 3600.0:.2f} h driven, {doubted} drives doubted")
    return doubted


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cars", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=36.0, help="of each of the ten styles")
    parser.add_argument("--first", type=int, default=1, help="seed of the first car")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--recordings", type=Path)
    a = parser.parse_args()
    if a.recordings:
        files = sorted(a.recordings.rglob("*.csv"))
        show(each(recorded, files, a.jobs, parts=len(files)))
        return
    cases = [(seed, style) for seed in range(a.first, a.first + a.cars) for style in STYLES]
    show(each(partial(drive, seconds=a.seconds), cases, a.jobs, parts=len(cases)))


if __name__ == "__main__":
    main()
