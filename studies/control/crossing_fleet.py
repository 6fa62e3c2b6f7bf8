"""The same arrivals on emulated cars with the mock of the Nano, by the true poses of the world and
the pulses at their ESCs: estimator, speed loop, contouring control, the fleet's room.

    python -m studies.control.crossing_fleet FILE [--layout intersection] [--seeds 50] [--first 0]
        [--loss 0 .3 .5] [--ways any] [--poses mocap|lidar|exact]
        [--fault dead|mute|restart|lost|silence] [--seconds 3600]
    python -m studies.control.crossing_fleet FILE --table

One JSON line for each arrival is appended to FILE; what it holds is not driven again. Cars are the
hidden ones of ``crossing_hidden``, by motion capture or by their lidars; exact: four of the later
published set whose files hold the truth. No new arrival begins after so many seconds of CPU.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import tempfile
import time
from dataclasses import dataclass
from itertools import combinations
from math import cos, hypot, inf, sin
from pathlib import Path

import numpy as np

from dart_hal.car import Car, Fleet, join
from dart_hal.control.crossing.coordinator import Coordinator
from dart_hal.control.crossing.crosser import Crosser
from dart_hal.control.crossing.layouts import LAYOUTS
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from studies.control import crossing_light as light
from studies.control.crossing_hidden import Hidden, seeds

PLACE = Path(__file__).parents[2] / "examples" / "use_cases" / "crossing.py"
NEUTRAL_US, NEAR_US = 1500.0, 5.0
ENDS, GONE = 25.0, 1.5
"""s of an arrival; s that a program that restarts is not there."""


def example():
    """The example as a module, as it is not in a package."""
    spec = importlib.util.spec_from_file_location("crossing_example", PLACE)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@dataclass(frozen=True)
class Fault:
    """Of one car from t [s] on. dead: its program does nothing; mute: it tells nothing; restart:
    its program is gone for ``GONE`` s while the speed loop holds 0, and back with its stamp; lost:
    without it; "": none."""

    kind: str = ""
    car: int = 0
    t: float = 0.0


def fault_of(kind, seed):
    """Of one car, anywhere on its way."""
    rng = np.random.default_rng([seed, 32])
    return Fault(kind, int(rng.integers(0, 4)), float(rng.uniform(0.5, 8.0)))


NO_FAULT = Fault()


class Emulated:
    """Some cars of one layout. rows: t, (x, y) of each middle, ``Wait`` of each, time of each
    world; pulses: of each car's ESC (rise, fall) [s]."""

    def __init__(self, layout, routes, room: str, folder: str, world: str, hidden=None,
                 cars=(), *, by_plans=False) -> None:
        """hidden: ``Hidden`` and the seeds of its cars; None: the example's own; by_plans: they
        share their plans instead of an order."""
        self.layout, self.of = layout, example()
        self.of.ROUTES = tuple(routes)
        if hidden is None:
            self.of.files(folder)
        self.worlds, opened, self.pulses = [], [], [[] for _ in routes]
        for n, (start, seen) in enumerate(zip(routes, self.pulses, strict=True)):
            url, poses = self.of.url(layout, *start, world), None
            if hidden is not None:
                at = url.partition("&at=")[2].partition("&")[0]
                url, poses = f"{hidden.url(cars[n])}&world={world}&at={at}", hidden.poses(at)
            backend = open_backend(url)
            self.worlds.append(world_of(backend))
            self.worlds[-1].watchers.append(
                lambda channel, pulse, seen=seen: seen.append(pulse) if channel == 1 else None)
            opened.append(Car.over(backend, cars=folder, poses=poses))
        self.fleet = Fleet(opened)
        self.fleet.members = tuple(join(car, room, name=name) for car, name in zip(
            opened, self.fleet.names, strict=True))
        make = self.of.plan_crossers if by_plans else self.of.crossers
        self.minds = make(self.fleet, layout)
        self.lanes = [layout.routes[layout.number(route)].lane for route, _ in routes]
        self.rows, self.across, self.kept = [], [inf] * len(opened), [0] * len(opened)
        for n, mind in enumerate(() if by_plans else self.minds):
            self._keep(n, mind)

    def _keep(self, n, mind) -> None:
        mind.coordinator.store_stamp = lambda stamp: self.kept.__setitem__(n, stamp)

    def drive(self, seconds: float, fault=NO_FAULT) -> None:
        """Until all are across or the time is over."""
        fleet, begun = self.fleet, None
        fleet.arm()
        for states in fleet.states(duration=seconds):
            begun = states[0].t if begun is None else begun
            t = states[0].t - begun
            motions = [state.estimate.predict(car.now)
                       for state, car in zip(states, fleet.cars, strict=True)]
            for k in range(len(motions)):
                if fault.kind and k == fault.car and t > fault.t:
                    self._faulty(k, motions, t, fault)
                else:
                    self._answer(k, motions)
            self.rows.append((t, self.middles(), [mind.wait for mind in self.minds],
                              [world.t for world in self.worlds]))
            for k, mind in enumerate(self.minds):
                if mind.s > self.layout.exit[mind.route]:
                    self.across[k] = min(self.across[k], t)
            if max(self.across) < inf:
                return

    def _answer(self, k, motions, mute=False) -> None:
        car, member, mind = self.fleet.cars[k], self.fleet.members[k], self.minds[k]
        came = [(c.payload, c.age) for c in member.coordination().values()]
        command = mind.answer(motions[k], came, self.of.free(k, mind, motions, self.lanes))
        if command.message and not mute:
            member.tell_coordination(command.message)
        car.drive_speed(steering=command.steering, speed=command.speed)

    def _faulty(self, k, motions, t, fault) -> None:
        """What a car does that has a fault."""
        if fault.kind == "mute":
            self._answer(k, motions, mute=True)
        elif fault.kind != "dead":
            if t < fault.t + GONE:
                self.fleet.cars[k].drive_speed(steering=0.0, speed=0.0)
                self.fleet.members[k].coordination()
                return
            if self.minds[k].coordinator.car.boot != 1 + k:
                self.minds[k] = self._again(k, motions[k].pose, fault.kind == "restart")
            self._answer(k, motions)

    def _again(self, k, pose, keeps):
        """The car's program after a restart, in session 1 + k: those before were drawn."""
        old = self.minds[k]
        mind, (x, y) = old.coordinator, self.of.middle(pose)
        s = old.path.spacing * float(np.argmin(np.hypot(old.path.x - x, old.path.y - y)))
        leader = "" if mind._leader is None else mind.names[mind._leader]
        made = Crosser(Coordinator(self.layout, mind.names, mind.names[k],
                                   self.layout.routes[mind.route].name, s, 1 + k, leader=leader,
                                   stored_stamp=self.kept[k] if keeps else 0), old.plant)
        made.start = old.start
        self._keep(k, made)
        return made

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
            at = self.layout.routes[self.layout.number(route)].path.interpolate(s - self.of.AXLE)
            mind.start = at.x, at.y, at.heading
        return self

    def __exit__(self, *error):
        self.fleet.close()


def arrival(given, hidden, seed, kind, loss) -> dict:
    """One arrival, as it is kept."""
    begun, layout = time.process_time(), LAYOUTS[given.layout]()
    routes = [(s.route, s.s) for s in light.arrivals(layout, seed, kind, given.ways)]
    chance = 1.0 if given.fault == "silence" else loss
    room = f"local://arrival{seed}?loss={chance:g}&delay=0.01&jitter=0.04&seed={seed}"
    drawn = seeds(seed, kind)
    with tempfile.TemporaryDirectory() as own:
        folder = str(hidden.folder) if hidden else own
        fault = fault_of(given.fault, seed) if given.fault not in ("", "silence") else NO_FAULT
        with Emulated(layout, routes, room, folder, f"arrival{seed}", hidden, drawn) as cars:
            cars.drive(ENDS, fault)
            outcomes = sum((mind.tracker.mpcc.outcomes for mind in cars.minds),
                           type(cars.minds[0].tracker.mpcc.outcomes)())
            return {
                "kind": kind, "cars": drawn if hidden else [], "least": round(cars.least, 4),
                "across": [round(t, 2) if t < inf else None for t in cars.across],
                "contacts": len(cars.fleet.contacts),
                "plans": {str(k): n for k, n in outcomes.items()},
                "why": [mind.why for mind in cars.minds],
                "fault": [fault.kind, fault.car, round(fault.t, 2)],
                "cpu": round(time.process_time() - begun, 1)}


def table(rows) -> None:
    """A line for each case."""
    cases = {}
    for row in rows:
        cases.setdefault(tuple(row["case"]), []).append(row)
    for (layout, ways, poses, fault, loss), of in sorted(cases.items()):
        last = np.array([max(inf if t is None else t for t in row["across"]) for row in of])
        print(f"{layout}, {ways}, {poses}, loss {loss:g} {fault}: {len(of)} arrivals, "
              f"{sum(r['kind'] == 'symmetric' for r in of)} exactly alike; least "
              f"{min(r['least'] for r in of):.3f} m, {sum(r['contacts'] for r in of)} contacts; "
              f"in 12 s {np.sum(last <= 12.0)}, worst {last.max():.1f} s, not in {ENDS:g} s "
              f"{np.sum(last == inf)}; gave up {sum(any(r['why']) for r in of)}; "
              f"{np.mean([r['cpu'] for r in of]):.1f} s CPU each")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--layout", choices=tuple(LAYOUTS), default="intersection")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--loss", type=float, nargs="*", default=[0.5])
    parser.add_argument("--ways", choices=("straight", "any"), default="straight")
    parser.add_argument("--poses", choices=("mocap", "lidar", "exact"), default="mocap")
    parser.add_argument("--fault", choices=("dead", "mute", "restart", "lost", "silence"),
                        default="")
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    lines = given.file.read_text().splitlines() if given.file.exists() else []
    rows = [json.loads(line) for line in lines]
    if given.table:
        table(rows)
        return
    done = {(*row["case"], row["seed"], row["kind"]) for row in rows}
    with tempfile.TemporaryDirectory() as folder, given.file.open("a") as kept:
        hidden = Hidden(Path(folder), given.poses == "lidar") if given.poses != "exact" else None
        for seed, kind in reversed(light.kinds(given.seeds)):  # the exactly alike first
            for loss in given.loss:
                case = (given.layout, given.ways, given.poses, given.fault, loss)
                seed_of = seed + given.first
                if (*case, seed_of, kind) in done or time.process_time() > given.seconds:
                    continue
                row = {"case": case, "seed": seed_of} | arrival(given, hidden, seed_of, kind, loss)
                kept.write(json.dumps(row) + "\n")
                kept.flush()
                print(row, flush=True)


if __name__ == "__main__":
    main()
