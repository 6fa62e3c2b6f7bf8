"""Lap times of the least-curvature line and the minimum-time line: predicted, and driven.

    python -m studies.control.line_figures [--half-width 0.3] [--cap 5] [--tracker lqr mpcc]

Three laps on the light simulation by the exact model of the later published set, at the limit of
the speed profile; the second lap counts. Some 30 s a track.
"""

from __future__ import annotations

import argparse

import numpy as np

from dart_hal.control.follow import Follower, Rules
from dart_hal.control.lap import speed_profile
from dart_hal.control.paths import Path
from dart_hal.control.raceline import minimum_time_line, raceline
from dart_hal.control.trackers import TRACKERS
from dart_hal.control.tracks import track_named
from studies.control.light_follow import LATER, light_drive, plant_by

TRACK_NAMES = ("racetrack_vicon_2", "savoiardo")


def drive_laps(line: Path, cap: float, tracker: str = "lqr", laps: int = 3
               ) -> tuple[float, float, float, str]:
    """Return the lap time of the profile [s], that of the second lap, the largest offset [m] and
    the reason of the end."""
    follower = Follower(line, plant_by(LATER), cap, tracker, Rules(laps=laps))
    rows = light_drive(follower)
    laps_driven = follower.driven.lap_times
    return (follower.expected, laps_driven[1] if len(laps_driven) > 1 else np.nan,
            float(np.abs(rows[:, 3]).max()), follower.why)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half-width", type=float, default=0.3)
    parser.add_argument("--cap", type=float, default=5.0)
    parser.add_argument("--tracker", nargs="*", choices=list(TRACKERS), default=["lqr"])
    given = parser.parse_args()
    plant = plant_by(LATER)
    for name in TRACK_NAMES:
        middle = track_named(name)
        lines = {"middle": middle,
                 "least curvature": raceline(middle, given.half_width, plant, given.cap),
                 "minimum time": minimum_time_line(middle, given.half_width, plant, given.cap)}
        for kind, line in lines.items():
            print(f"{name}, {kind}: predicted {speed_profile(line, plant, given.cap).time:.3f} s",
                  flush=True)
            for tracker in given.tracker:
                _, driven, most, why = drive_laps(line, given.cap, tracker)
                print(f"  {tracker}: driven {driven:.3f} s, largest offset {most:.3f} m; {why}",
                      flush=True)


if __name__ == "__main__":
    main()
