"""Which pulses are driven in which order, and how much floor and time that takes.

The path on the floor is a chain of arcs. Before each sweep the car circles until the sweep, for
every car that it may be, stays near the start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Steering
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

SPEEDS = (0.35, 0.55)  # m/s; slow, and apart enough to tell the slip
LEVELS = 13
SETTLE = 0.8  # s; delay 0.15, five servo lags, the PI's answer to the new drag
MEASURE = 0.7  # s; about 5 revolutions of the ring
STANDSTILL = 3.0  # s for the gyro bias
START = 3.0  # s to reach the first speed
MARGIN = 1.0  # m; half a car, and what the prediction of the path misses
TRIMS = (-0.06, -0.03, 0.0, 0.03, 0.06)  # of the command range
GAINS = (0.9, 1.1)
PLAYS = (0.01, 0.03, 0.05)  # rad, full width of the loop and what the servo lags
DT = 0.1  # s between points of a predicted path
CANDIDATES = 36  # headings that are tried on one circle


@dataclass(frozen=True, slots=True)
class Step:
    """One window: command -1..1 and its pulse, direction of approach, reference speed [m/s]."""

    command: float
    pulse_us: float
    direction: int
    speed: float


@dataclass(frozen=True, slots=True)
class Plan:
    """What the procedure will do, to be shown before anything moves.

    time s at most, radius m of the free floor around the start, speed m/s at
    most, path m at most.
    """

    steps: tuple[Step, ...]
    time: float
    radius: float
    speed: float
    path: float
    wheelbase: float
    tools: tuple[str, ...] = ()

    def __str__(self) -> str:
        return (f"drives about {self.path:.0f} m of slow arcs in at most {self.time:.0f} s at up "
                f"to {self.speed:.2f} m/s, from full right to full left and back; needs a free "
                f"floor of {self.radius:.1f} m around the car")

    @property
    def forth(self) -> tuple[Step, ...]:
        """The sweep from right to left."""
        return self.steps[:len(self.steps) // 2]

    @property
    def back(self) -> tuple[Step, ...]:
        """The sweep from left to right."""
        return self.steps[len(self.steps) // 2:]


def make_steps(*, center_us: float, span_us: float, direction: int, count: float,
               levels: int = LEVELS, speeds: tuple[float, float] = SPEEDS) -> tuple[Step, ...]:
    """From full right to full left slowly, and back faster.

    Every pulse is a whole number of counts, so that no dithering moves the
    servo to and fro inside its backlash.
    """
    spots = []
    for i in range(levels):
        wanted = -1.0 + 2.0 * i / (levels - 1)
        ticks = round((center_us + direction * span_us * wanted) / count)
        pulse = ticks * count
        spots.append(((pulse - center_us) / (direction * span_us), pulse))
    steps: list[Step] = []
    at = 0.0
    for rising, speed in ((True, speeds[0]), (False, speeds[1])):
        for command, pulse in spots if rising else spots[::-1]:
            direction = (command > at) - (command < at) or (steps[-1].direction if steps else 0)
            steps.append(Step(command, pulse, direction, speed))
            at = command
    return tuple(steps)


def possible_cars() -> list[tuple[Steering, float]]:
    """(map, backlash [rad]) of cars that differ in trim, gain and play."""
    base = PAPER.steering
    return [(replace(base, s0=base.s0 + trim, a_left_rad=base.a_left_rad * gain,
                     a_right_rad=base.a_right_rad * gain), play)
            for trim in TRIMS for gain in GAINS for play in PLAYS]


def legs_of(steps: tuple[Step, ...], wheelbase: float, car: tuple[Steering, float]) -> list[Leg]:
    """Arcs of a sweep on that car: the wheels lag half the backlash behind. wheelbase [m]."""
    steering, play = car
    curve = make_steering(steering)
    return [Leg(s.speed, s.speed * math.tan(curve(s.command) - 0.5 * play * s.direction)
                / wheelbase, SETTLE + MEASURE) for s in steps]


def return_futures(back: tuple[Step, ...], yaw_per_metre: list[float], wheelbase: float
                   ) -> list[list[Leg]]:
    """The sweep back, from what the sweep there showed; the backlash is not known yet.

    yaw_per_metre [rad/m] of the levels in the order of ``back``.
    """
    return [[Leg(s.speed, s.speed * (k + play / wheelbase), SETTLE + MEASURE)
             for s, k in zip(back, yaw_per_metre, strict=True)] for play in PLAYS]


@lru_cache(maxsize=8)
def make_plan(steps: tuple[Step, ...], wheelbase: float) -> Plan:
    """Time, path and floor: the largest over all possible cars."""
    plan = Plan(steps, 0.0, 0.0, max(s.speed for s in steps), 0.0, wheelbase)
    time = radius = path = 0.0
    futures = [legs_of(plan.forth, wheelbase, car) for car in possible_cars()]
    for car in possible_cars():
        legs = _rehearse(plan, car, futures)
        points, _ = trace(Spot(0.0, 0.0, 0.0), legs)
        radius = max(radius, float(np.hypot(points[:, 0], points[:, 1]).max()))
        time = max(time, sum(g.seconds for g in legs))
        path = max(path, sum(g.seconds * g.speed for g in legs))
    return replace(plan, time=STANDSTILL + time + 1.0, radius=radius + MARGIN, path=path)


def _rehearse(plan: Plan, car: tuple[Steering, float], futures: list[list[Leg]]) -> list[Leg]:
    """Everything that this car would drive: start, wait, sweep, wait, sweep."""
    forth = legs_of(plan.forth, plan.wheelbase, car)
    back = legs_of(plan.back, plan.wheelbase, car)
    start = Leg(forth[0].speed, forth[0].yaw_rate, START + SETTLE)
    centre = (0.0, 0.0)
    _, at = trace(Spot(0.0, 0.0, 0.0), [start])
    first = waiting_time(at, forth[0].speed, forth[0].yaw_rate, futures, centre)
    legs = [start, Leg(forth[0].speed, forth[0].yaw_rate, first), *forth,
            Leg(back[0].speed, back[0].yaw_rate, SETTLE)]
    _, at = trace(Spot(0.0, 0.0, 0.0), legs)
    seen = [g.yaw_rate / g.speed for g in forth[::-1]]
    second = waiting_time(at, back[0].speed, back[0].yaw_rate,
                          return_futures(plan.back, seen, plan.wheelbase), centre)
    return [*legs, Leg(back[0].speed, back[0].yaw_rate, second), *back]


class Leg(NamedTuple):
    """An arc: speed [m/s], yaw rate [rad/s], seconds."""

    speed: float
    yaw_rate: float
    seconds: float


class Spot(NamedTuple):
    """Place [m] and heading [rad] on the floor."""

    x: float
    y: float
    yaw: float


def trace(start: Spot, legs: Sequence[Leg]) -> tuple[FloatArray, Spot]:
    """(points (n, 2) m, last spot) of arcs driven one after the other."""
    turns = np.concatenate([np.full(max(round(g.seconds / DT), 0), g.yaw_rate) for g in legs])
    speeds = np.concatenate([np.full(len_, g.speed) for g, len_ in
                             ((g, max(round(g.seconds / DT), 0)) for g in legs)])
    yaw = start.yaw + np.concatenate([[0.0], np.cumsum(turns * DT)])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    x = start.x + np.concatenate([[0.0], np.cumsum(speeds * np.cos(middle) * DT)])
    y = start.y + np.concatenate([[0.0], np.cumsum(speeds * np.sin(middle) * DT)])
    return np.column_stack([x, y]), Spot(float(x[-1]), float(y[-1]), float(yaw[-1]))


def waiting_time(at: Spot, speed: float, yaw_rate: float, futures: Sequence[Sequence[Leg]],
                 centre: tuple[float, float]) -> float:
    """Seconds to stay on the circle (speed, yaw_rate) before what follows; at most one turn.

    ``futures``: the sweep to come on each car that this one may be. The heading
    with the smallest largest distance from ``centre`` [m] over them all wins.
    """
    if abs(yaw_rate) < 0.1:
        return 0.0
    times = np.arange(CANDIDATES) * (2.0 * math.pi / abs(yaw_rate) / CANDIDATES)
    yaw = at.yaw + yaw_rate * times
    radius = speed / yaw_rate
    x = at.x + radius * (np.sin(yaw) - math.sin(at.yaw)) - centre[0]
    y = at.y - radius * (np.cos(yaw) - math.cos(at.yaw)) - centre[1]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    worst = np.zeros(CANDIDATES)
    for legs in futures:
        local, _ = trace(Spot(0.0, 0.0, 0.0), legs)
        px = x[:, None] + c * local[:, 0] - s * local[:, 1]
        py = y[:, None] + s * local[:, 0] + c * local[:, 1]
        worst = np.maximum(worst, np.hypot(px, py).max(axis=1))
    return float(times[int(np.argmin(worst))])
