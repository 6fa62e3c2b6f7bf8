"""Drives of cars whose model is 20 to 30 % off: how many leave the lane, careful or not.

    python -m studies.control.wrong_models --cases 20 --tracker lqr --speed 2 --seed 79
    python -m studies.control.wrong_models --obstacle --tracker ca-mpcc --off 0.05 0.15 --seed 79

Mass, inertia, friction, motor and tyres of each car differ from the model that the tracker knows,
each by a random amount to a random side. The light simulation drives two laps; with --obstacle one
lap past a disc of 0.15 m, 0.15 m off the middle, that moves on at 0.5 m/s.
"""

from __future__ import annotations

import argparse
from math import cos, sin

import numpy as np

from dart_hal.control.follow import Follower, Rules
from dart_hal.control.mpc.obstacles import Disc
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.trackers import contouring, curvature_aware
from dart_hal.control.tracks import track_named
from dart_hal.vehicle.flat import bind, values
from dart_hal.vehicle.parameters import Vehicle
from studies.control.light_follow import LATER, light_drive, plant_by

VARIED = ("body.mass", "body.yaw_inertia", "friction.", "motor.", "tyres.")
LAPS = 2
RADIUS, SIDE, OBSTACLE_SPEED = 0.15, 0.15, 0.5
"""m, m off the middle, m/s of the obstacle."""
DURATION = 60.0
"""s at most for two laps."""


def vary(p: Vehicle, low: float, high: float, rng: np.random.Generator) -> Vehicle:
    """A vehicle with each varied parameter off by a share between ``low`` and ``high``."""
    known = values(p)

    def change_value(name: str) -> float:
        if not name.startswith(VARIED):
            return known[name]
        return known[name] * (1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(low, high))

    return bind(p, change_value)


def drive_once(car: Vehicle, tracker: str, speed: float, *, careful: bool
               ) -> tuple[float, list[float]]:
    """(largest offset [m], lap times [s]) of a drive by the nominal model."""
    follower = Follower(track_named("racetrack_vicon_2"), plant_by(LATER), speed, tracker,
                        Rules(LAPS, careful=careful))
    rows = light_drive(follower, car, seconds=DURATION)
    return float(np.abs(rows[:, 3]).max()), follower.driven.lap_times


def pass_once(car: Vehicle, tracker: str, speed: float, distance: float, side: float
              ) -> tuple[float, float, str]:
    """(largest offset [m], least air to the disc [m], reason of the end) of a lap."""
    def make(path: Path, plant: Plant) -> Contouring:
        spot = path.interpolate(distance)
        disc = Disc(spot.x - side * sin(spot.heading), spot.y + side * cos(spot.heading),
                    RADIUS, OBSTACLE_SPEED)
        return {"mpcc": contouring, "ca-mpcc": curvature_aware}[tracker](
            path, plant, discs=(disc,))

    follower = Follower(track_named("racetrack_vicon_2"), plant_by(LATER), speed, make, Rules(1))
    rows = light_drive(follower, car, seconds=DURATION)
    assert isinstance(follower.tracker, Contouring)
    return float(np.abs(rows[:, 3]).max()), follower.tracker.air[0], follower.why


def pass_obstacles(cases: int, tracker: str, speed: float, off: tuple[float, float],
                   rng: np.random.Generator) -> None:
    """Print a line for each car that passes an obstacle, and the counts."""
    lane = Rules().lane
    rows = []
    for k in range(cases):
        car = vary(LATER, *off, rng)
        place = float(rng.uniform(4.0, 12.0)), float(rng.choice((-SIDE, SIDE)))
        rows.append(pass_once(car, tracker, speed, *place))
        offset, air, why = rows[-1]
        print(f"  car {k}: {offset:.3f} m, air {air:.3f} m, {why}", flush=True)
    offsets = np.array([row[0] for row in rows])
    print(f"{tracker}: {np.sum(offsets > lane)} of {cases} outside, largest {offsets.max():.3f} m, "
          f"least air {min(row[1] for row in rows):.3f} m")


def main() -> None:
    """Print a line for each car and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--tracker", default="lqr")
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=79)
    parser.add_argument("--off", type=float, nargs=2, default=(0.2, 0.3))
    parser.add_argument("--obstacle", action="store_true")
    given = parser.parse_args()
    if given.obstacle:
        pass_obstacles(given.cases, given.tracker, given.speed, given.off,
                       np.random.default_rng(given.seed))
        return
    lane = Rules().lane
    for careful in (False, True):
        rng = np.random.default_rng(given.seed)
        outside = 0
        for k in range(given.cases):
            offset, laps = drive_once(vary(LATER, *given.off, rng), given.tracker, given.speed,
                                      careful=careful)
            outside += offset > lane
            print(f"  car {k}: {offset:.2f} m, laps", " ".join(f"{t:.1f}" for t in laps))
        print(f"{'careful' if careful else 'at once'}: {outside} of {given.cases} outside")


if __name__ == "__main__":
    main()
