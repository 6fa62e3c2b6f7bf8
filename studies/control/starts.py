"""Random starts within 1 m and 90 deg of a path: how many leave the lane, how many are refused.

    python -m studies.control.starts --cases 400 --tracker lqr --speed 1 --seed 101

The light simulation drives the first seconds of each, on two tracks in turn.
"""

from __future__ import annotations

import argparse
from collections import Counter
from math import cos, pi, sin

import numpy as np

from dart_hal.control.follow import MAX_START_DISTANCE, Follower, Phase
from dart_hal.control.plant import Plant
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from studies.control.light_follow import LATER, light_drive, plant_by

TRACKS = ("racetrack_vicon_2", "savoiardo")
DURATION = 7.0
"""s of each drive: from 1 m off a path into the lane."""


def start_once(track: str, plant: Plant, tracker: str, speed: float,
               rng: np.random.Generator) -> tuple[str, float, float]:
    """(outcome, largest offset [m], largest one since the car was in the lane) of a random start.
    """
    path = track_named(track)
    spot = path.interpolate(rng.uniform(0.0, path.length))
    offset = rng.uniform(-MAX_START_DISTANCE, MAX_START_DISTANCE)
    yaw = spot.heading + rng.uniform(-0.5 * pi, 0.5 * pi)
    start = (spot.x - offset * sin(spot.heading), spot.y + offset * cos(spot.heading), yaw)
    follower = Follower(path, plant, cap=speed, tracker=tracker)
    is_following = []

    def observe(t, follower, motion):
        is_following.append(follower.phase is Phase.FOLLOWING)
        return motion

    try:
        rows = light_drive(follower, LATER, start=start, seconds=DURATION, each=observe)
    except UsageError:
        return "refused", 0.0, 0.0
    offsets = np.abs(rows[:, 3])
    outcome = follower.why.split(":")[0] or ("follows" if is_following[-1] else "joins")
    return outcome, offsets.max(), offsets[np.array(is_following)].max(initial=0.0)


def main() -> None:
    """Print the outcomes of the cases."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--tracker", default="lqr")
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=101)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    plant = plant_by(LATER)
    cases = [start_once(TRACKS[n % len(TRACKS)], plant, given.tracker, given.speed, rng)
             for n in range(given.cases)]
    outcomes = Counter(outcome for outcome, _, _ in cases)
    print(f"{given.tracker}, {given.speed:g} m/s:",
          ", ".join(f"{name} {count}" for name, count in outcomes.most_common()))
    print(f"largest offset {max(case[1] for case in cases):.2f} m; "
          f"in the lane {max(case[2] for case in cases):.2f} m")


if __name__ == "__main__":
    main()
