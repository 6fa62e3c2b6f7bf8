"""How much air is left beside obstacles that hidden cars pass, by their true bodies.

    python -m studies.control.obstacle_figures --seeds 50 [--first 1] [--speed 2] [--moving 0.5]

One disc of 0.15 m on each drive of ``follow_figures``, 4 to 12 m on and 0.15 m to one side, which
moves on along the path at so many m/s. Some 5 s a car.
"""

from __future__ import annotations

import argparse
from math import cos, sin

import numpy as np

from dart_hal.control.mpc.obstacles import Disc, clearance
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.trackers import contouring
from studies.control.follow_figures import driven

WANTED, RADIUS, LAPS = 0.05, 0.15, 0.8


def passed(seed: int, speed: float, moving: float, side: float = 0.15) -> tuple[float, float, str]:
    """(least true air, the same by the car's estimate) [m], and how the drive ended."""
    rng = np.random.default_rng([seed, 9])
    ahead, offset = float(rng.uniform(4.0, 12.0)), float(rng.choice((-side, side)))

    def make(path: Path, plant: Plant) -> Contouring:
        spot = path.interpolate(ahead)
        disc = Disc(spot.x - offset * sin(spot.heading), spot.y + offset * cos(spot.heading),
                    RADIUS, moving)
        return contouring(path, plant, discs=(disc,))

    drive = driven(seed, speed, tracker=make, laps=LAPS)
    tracker = drive.follower.tracker
    assert isinstance(tracker, Contouring)
    (obstacle,), middle = tracker.mpcc.obstacles, tracker.plant.vehicle.body.l_r
    least = min(
        clearance(x + middle * cos(yaw), y + middle * sin(yaw), yaw, obstacle, tracker.path, t)
        for t, x, y, yaw in zip(drive.t, drive.x, drive.y, drive.yaw, strict=True)
    )
    return least, tracker.air[0], drive.follower.why


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument("--moving", type=float, default=0.5)
    given = parser.parse_args()
    rows = []
    for seed in range(given.first, given.first + given.seeds):
        rows.append(passed(seed, given.speed, given.moving))
        print(f"{seed}: {100.0 * rows[-1][0]:.1f} cm, {100.0 * rows[-1][1]:.1f} by its estimate; "
              f"{rows[-1][2]}", flush=True)
    least = np.array([row[0] for row in rows])
    print(f"{np.sum(least >= WANTED)} of {len(least)} with 5 cm or more; least "
          f"{100.0 * least.min():.1f} cm, mean {100.0 * least.mean():.1f}; "
          f"{sum(row[2] == 'the path is driven' for row in rows)} drove it all")


if __name__ == "__main__":
    main()
