"""Cars of a team as beads on their curve: they keep on it, and follow a speed late and as steeply
as a car can. Messages are lost, cars fall silent, and stand where nobody expects it.

    python -m studies.control.monitoring_beads --scenarios 200     (about 2 s each)
"""

from __future__ import annotations

import argparse
from collections import Counter, deque
from math import cos, pi, sin
from types import SimpleNamespace

import numpy as np

from dart_hal.control.monitoring.formation import Formation
from dart_hal.control.monitoring.guard import CENTRE_OFFSET
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.monitoring.monitor import Monitor
from dart_hal.control.monitoring.peer import PLAN_STEP
from dart_hal.core.types import Pose
from dart_hal.vehicle.sets import PAPER
from studies.control.light_follow import motion_at, plant_by

TEAM = Formation(Lissajous(3.3, 0.9, 1, 2), 3, 1)
OMEGA, K = 0.25, 0.25
DT, LATE = 0.05, 2
"""s of a step, which is also from message to message; steps from a decision to the drive."""
UP, DOWN = 2.8, 2.0
"""m/s2."""
NAMES = ("red", "green", "blue", "white", "black")
FIVE = Formation(Lissajous(3.9, 7.8, 3, 2), 5, 2)
TEAMS = {3: (TEAM, OMEGA), 5: (FIVE, 0.07)}
PLANT = plant_by(PAPER)


class Bead:
    """One car: s [m], v [m/s]; dead: it brakes, stands, and tells nothing any more."""

    def __init__(self, name: str, X: float, cars: int, guard: bool) -> None:
        team, omega = TEAMS[cars]
        self.monitor = Monitor(team, NAMES[:cars], name, PLANT, omega, omega, guard=guard)
        self.name, self.v, self.dead = name, 0.0, False
        self.s = self.monitor.course.arc_length(X)
        self._asked = deque([0.0] * LATE)

    @property
    def place(self):
        spot = self.monitor.course.path.interpolate(self.s)
        return np.array(
            (spot.x + CENTRE_OFFSET * cos(spot.heading), spot.y + CENTRE_OFFSET * sin(spot.heading))
        )

    def go(self, t: float, told: dict) -> None:
        spot = self.monitor.course.path.interpolate(self.s)
        motion = motion_at(t, Pose(spot.x, spot.y, spot.heading), self.v, self.v * spot.curvature)
        self._asked.append(0.0 if self.dead else self.monitor.answer(motion, told).speed)
        wanted = self._asked.popleft()
        self.v += min(max(wanted - self.v, -DOWN * DT), UP * DT)
        self.s += self.v * DT


def scenario(seed: int, loss: float, seconds: float = 25.0, *, guard: bool = True,
             dies: bool = False, cars: int = 3):
    """(least distance between two middles [m], modes, largest disagreement at the end [rad]) of
    cars that begin anywhere, 0.6 m apart at least; dies: one of them, at some time."""
    rng = np.random.default_rng([seed, 9])
    while True:
        beads = [Bead(name, float(X), cars, guard) for name, X in
                 zip(NAMES, rng.uniform(0.0, 2.0 * pi, cars), strict=False)]
        if _least(beads) > 0.6:
            break
    heard = {name: {} for name in NAMES[:cars]}
    least, death = np.inf, rng.uniform(3.0, 15.0) if dies else np.inf
    for k in range(round(seconds / DT)):
        t = k * DT
        beads[0].dead = t > death
        for bead in beads:
            plan = bead.monitor.plan()
            for other in beads:
                if bead is not other and not bead.dead and len(plan) and rng.random() >= loss:
                    heard[other.name][bead.name] = (t, plan)
        for bead in beads:
            bead.go(t, {name: SimpleNamespace(age=t - at, step=PLAN_STEP, points=plan)
                        for name, (at, plan) in heard[bead.name].items()})
        least = min(least, _least(beads))
    modes = sum((bead.monitor.answers for bead in beads), Counter())
    return least, modes, max(bead.monitor.disagreement(t) for bead in beads)


def _least(beads):
    at = np.array([bead.place for bead in beads])
    return min(np.linalg.norm(at[i] - at[j]) for i in range(len(at)) for j in range(i))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenarios", type=int, default=200)
    parser.add_argument("--cars", type=int, choices=sorted(TEAMS), default=3)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--no-guard", action="store_true")
    asked = parser.parse_args()
    for loss in (0.0, 0.3, 0.5, 0.8):
        for dies in (False, True):
            done = [scenario(seed, loss, asked.seconds, guard=not asked.no_guard, dies=dies,
                             cars=asked.cars)
                    for seed in range(asked.scenarios // 8)]
            least = [one[0] for one in done]
            modes = sum((one[1] for one in done), Counter())
            share = {str(mode): f"{n / modes.total():.0%}" for mode, n in modes.items()}
            even = sum(one[2] < 0.2 for one in done)
            print(f"loss {loss:.0%}, {'one dies' if dies else 'all live'}: {len(done)} scenarios, "
                  f"least distance {min(least):.3f} m, under 0.36 m {sum(d < 0.36 for d in least)},"
                  f" spread evenly at the end {even}; {share}", flush=True)


if __name__ == "__main__":
    main()
