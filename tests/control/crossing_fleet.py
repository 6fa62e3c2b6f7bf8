"""The same arrivals on emulated cars with the mock of the Nano, by the true poses of the world and
the pulses at their ESCs: estimator, speed loop, contouring control, the fleet's room.

    python -m tests.control.crossing_fleet [--seeds 3] [--loss 0.5]
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
import time
from itertools import combinations
from math import cos, hypot, inf, sin
from pathlib import Path

import numpy as np
from tests.control import crossing_light as light

from dart_hal.car import Car, Fleet, join
from dart_hal.control.crossing.layouts import LAYOUTS
from dart_hal.links.base import open_backend
from dart_hal.sim.truth import world_of

PLACE = Path(__file__).parents[2] / "examples" / "use_cases" / "crossing.py"
NEUTRAL_US, NEAR_US = 1500.0, 5.0


def example():
    """The example as a module, as it is not in a package."""
    spec = importlib.util.spec_from_file_location("crossing_example", PLACE)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


class Emulated:
    """Some cars of one layout. rows: t, (x, y, yaw) of each middle, ``Wait`` of each; pulses: of
    each car's ESC (rise, fall) [s]."""

    def __init__(self, layout, routes, room: str, folder: str, world: str) -> None:
        self.layout, self.of = layout, example()
        self.of.ROUTES = tuple(routes)
        self.of.files(folder)
        self.worlds, cars = [], []
        self.pulses = [[] for _ in routes]
        for start, seen in zip(routes, self.pulses, strict=True):
            backend = open_backend(self.of.url(layout, *start, world))
            self.worlds.append(world_of(backend))
            self.worlds[-1].watchers.append(
                lambda channel, pulse, seen=seen: seen.append(pulse) if channel == 1 else None)
            cars.append(Car.over(backend, cars=folder))
        self.fleet = Fleet(cars)
        self.fleet.members = tuple(join(car, room, name=name) for car, name in zip(
            cars, self.fleet.names, strict=True))
        self.minds = self.of.crossers(self.fleet, layout)
        self.rows, self.across = [], [inf] * len(cars)

    def drive(self, seconds: float) -> None:
        """Until all are across or the time is over."""
        fleet, minds, begun = self.fleet, self.minds, None
        fleet.arm()
        for states in fleet.states(duration=seconds):
            begun = states[0].t if begun is None else begun
            for state, car, member, mind in zip(states, fleet.cars, fleet.members, minds,
                                                strict=True):
                came = [(c.payload, c.age) for c in member.coordination().values()]
                command = mind.answer(state.estimate.at(car.now), came)
                if command.message:
                    member.tell_coordination(command.message)
                car.drive_speed(steering=command.steering, speed=command.speed)
            t = states[0].t - begun
            self.rows.append((t, self.middles(), [mind.last.wait for mind in minds],
                              [world.t for world in self.worlds]))
            for k, mind in enumerate(minds):
                if mind.s > self.layout.exit[mind.coordinator.route]:
                    self.across[k] = min(self.across[k], t)
            if max(self.across) < inf:
                return

    def middles(self):
        found = []
        for world, mind in zip(self.worlds, self.minds, strict=True):
            true, start = world.truth(), mind.start
            c, s = cos(start[2]), sin(start[2])
            yaw = start[2] + true.yaw
            found.append((start[0] + c * true.x - s * true.y + self.of.AXLE * cos(yaw),
                          start[1] + s * true.x + c * true.y + self.of.AXLE * sin(yaw)))
        return found

    @property
    def least(self) -> float:
        """m between two middles, by the truth."""
        return min(hypot(a[0] - b[0], a[1] - b[1]) for _, at, *_ in self.rows
                   for a, b in combinations(at, 2))

    def driving(self, n: int, begin: float, end: float) -> int:
        """Pulses at the ESC of car n that are not neutral, between two times [s]."""
        return sum(begin < fall < end and abs((fall - rise) * 1e6 - NEUTRAL_US) > NEAR_US
                   for rise, fall in self.pulses[n])

    def __enter__(self):
        for mind, (route, s) in zip(self.minds, self.of.ROUTES, strict=True):
            at = self.layout.routes[self.layout.number(route)].path.at(s - self.of.AXLE)
            mind.start = at.x, at.y, at.heading
        return self

    def __exit__(self, *error):
        self.fleet.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--loss", type=float, default=0.5)
    given = parser.parse_args()
    layout = LAYOUTS["intersection"]()
    for seed, kind in light.kinds(given.seeds):
        seed += given.first
        begun = time.process_time()
        routes = [(s.route, s.s) for s in light.arrivals(layout, seed, kind)]
        room = f"local://arrival{seed}?loss={given.loss:g}&delay=0.01&jitter=0.04&seed={seed}"
        with tempfile.TemporaryDirectory() as folder, \
                Emulated(layout, routes, room, folder, f"arrival{seed}") as cars:
            cars.drive(25.0)
            plans = np.sum([mind.tracker.mpcc.outcomes.total() for mind in cars.minds])
            print(f"{kind}, seed {seed}, loss {given.loss:g}: least {cars.least:.3f} m, last "
                  f"across {max(cars.across):.1f} s, contacts {len(cars.fleet.contacts)}, {plans} "
                  f"plans, {time.process_time() - begun:.0f} s CPU", flush=True)


if __name__ == "__main__":
    main()
