"""Figures of the detection of other cars on hidden drives; docs/results/localising.md shows them.

    python -m studies.detection.figures --first 100 --seeds 10              all
    python -m studies.detection.figures --first 100 --seeds 10 car people

Per distance from the lidar: errors of position and speed of the track of the car, share of the
scans with at least 5 beams on it that have a track, false tracks per minute, and the delay from the
first of three such scans in a row to the track. A track is false while its centre is further than
0.3 m from that of the car. One at rest is counted apart: at the car, at a new box, at a person, or
at nothing, if no corner of what stands there unmapped is within 0.3 m of its outline.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from dart_hal.estimation.localisation.localiser import Localiser
from dart_hal.estimation.other_cars.rectangle import CarSize
from dart_hal.estimation.other_cars.sweep import make_sweep
from dart_hal.estimation.other_cars.tracker import CarTracker
from dart_lab.sim.light.world import CAR_OUTLINE
from studies.detection.world import Scene, scene

SIZE = CarSize(CAR_OUTLINE.length, CAR_OUTLINE.width, CAR_OUTLINE.ahead)
MIN_BEAMS = 5
MAX_OFFSET = 0.3
RESTING_KINDS = ("car", "box", "person", "nothing")
DISTANCES = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0)
ROWS: dict[str, dict[str, float]] = {
    "car, one person, new boxes of 7 %": {},
    "car at rest": {"speed": 0.0},
    "car at 0.5 m/s": {"speed": 0.5}, "car at 1.6 m/s": {"speed": 1.6},
    "three people, no car": {"car": False, "people": 3},
    "car, noise 1 cm + 1 %": {"noise": 0.01, "noise_share": 0.01},
    "car, new boxes of 22 % of the walls": {"stale": 0.22},
}


@dataclass
class Errors:
    """rows: distance [m], error of position [m], of speed [m/s], time since the start of the track
    [s]; observed, tracked: distances of scans; false: numbers of false tracks; delays [s]."""

    rows: list[tuple[float, float, float, float]] = field(default_factory=list)
    observed: list[float] = field(default_factory=list)
    tracked: list[float] = field(default_factory=list)
    false: int = 0
    false_scans: int = 0
    at_rest: dict[str, set[tuple[int, int]]] = field(default_factory=lambda: defaultdict(set))
    scans: int = 0
    drives: int = 0
    seconds: float = 0.0
    delays: list[float] = field(default_factory=list)
    work: list[float] = field(default_factory=list)


def evaluate(found: Scene, errors: Errors, late: float = 0.010) -> None:
    """Let localiser and tracker follow a scene; the start is known."""
    drive = found.drive
    local = Localiser(drive.chart, tuple(drive.true(float(drive.scans[0].t[-1]) - late).tolist()))
    tracker = CarTracker(SIZE)
    begun: dict[int, float] = {}
    false: set[int] = set()
    waiting: list[float] = []
    k = 0
    for scan, hits in zip(drive.scans, found.hits, strict=True):
        while k < len(drive.t) and drive.t[k] <= scan.arrival:
            drive.tell(local, k)
            k += 1
        located = local.add(scan)
        if located is None or located.pose is None or local.beams is None:
            continue
        began = time.process_time()
        tracks = tracker.add(make_sweep(drive.chart, local.beams, located.pose))
        errors.work.append(time.process_time() - began)
        own = drive.true(located.t)
        right = False
        for track in tracks:
            begun.setdefault(track.number, track.t)
            if track.at_rest:
                kind = name_resting(found, centre(track.mean), track.t)
                errors.at_rest[kind].add((errors.drives, track.number))
                if kind != "car":
                    continue
            if found.other is None:
                false.add(track.number)
                errors.false_scans += 1
                continue
            now = track.predict(located.t)
            true = found.true(now.t)
            off = centre(now.mean) - centre(true)
            if np.hypot(*off) > MAX_OFFSET:
                false.add(track.number)
                errors.false_scans += 1
                continue
            right = True
            distance = float(np.hypot(*(centre(true) - own[:2])))
            if hits >= MIN_BEAMS:
                errors.rows.append((distance, float(np.hypot(*off)),
                                    float(abs(now.mean[3]) - true[3]),
                                    now.t - begun[track.number]))
        errors.scans += 1
        if found.other is None:
            continue
        if hits >= MIN_BEAMS:
            distance = float(np.hypot(*(centre(found.true(located.t)) - own[:2])))
            errors.observed.append(distance)
            waiting.append(located.t)
            if right:
                errors.tracked.append(distance)
        else:
            waiting = []
        if right:
            if len(waiting) > 2:
                errors.delays.append(located.t - waiting[0])
            waiting = [-np.inf]  # a track: no delay until it has ended
        elif waiting and waiting[0] == -np.inf:
            waiting = []
    errors.false += len(false)
    errors.drives += 1
    errors.seconds += drive.t[-1] - drive.t[0]


def centre(pose: np.ndarray) -> np.ndarray:
    """Centre of the body of an axle pose."""
    return pose[:2] + SIZE.centre_x * np.array((np.cos(pose[2]), np.sin(pose[2])))


def name_resting(found: Scene, place: np.ndarray, t: float) -> str:
    """Name what is unmapped within 0.3 m, and half a car, of the centre (2,) of a track."""
    reach = MAX_OFFSET + 0.5 * SIZE.length
    if found.other is not None and np.hypot(*(centre(found.true(t)) - place)) < MAX_OFFSET:
        return "car"
    new = found.drive.lines[len(found.drive.room.lines):].reshape(-1, 2)
    if len(new) and np.hypot(*(new - place).T).min() < reach:
        return "box"
    k = min(int(np.searchsorted(found.drive.t, t)), len(found.drive.t) - 1)
    if any(np.hypot(*(walk[k, :2] - place)) < reach for walk in found.walks):
        return "person"
    return "nothing"


def report(name: str, errors: Errors) -> None:
    """Print the rows of one kind of drive."""
    rows = np.array(errors.rows).reshape(-1, 4)
    observed, tracked = (np.array(v) for v in (errors.observed, errors.tracked))
    print(f"{name}: {errors.seconds:.0f} s, false tracks {errors.false} "
          f"({60.0 * errors.false / errors.seconds:.2f} per minute, "
          f"{100 * errors.false_scans / errors.scans:.1f} % of the scans), "
          f"delay median {np.median(errors.delays) if errors.delays else np.nan:.2f} s, greatest "
          f"{max(errors.delays, default=np.nan):.2f} s of {len(errors.delays)}, "
          f"{1e3 * np.median(errors.work):.1f} ms a scan; tracks at rest "
          + ", ".join(f"{len(errors.at_rest[kind])} at {kind}" for kind in RESTING_KINDS))
    for low, high in pairwise(DISTANCES):
        here = rows[(rows[:, 0] >= low) & (rows[:, 0] < high)]
        share = (np.sum((tracked >= low) & (tracked < high))
                 / max(np.sum((observed >= low) & (observed < high)), 1))
        if len(here):
            off = np.abs(here)
            print(f"  {low:.0f} to {high:.0f} m: n {len(here):5d}, tracked {100 * share:3.0f} %, "
                  f"position rms {100 * rms(here[:, 1]):4.1f} cm, 95 % "
                  f"{100 * np.quantile(off[:, 1], 0.95):4.1f} cm, speed rms {rms(here[:, 2]):.3f}, "
                  f"95 % {np.quantile(off[:, 2], 0.95):.3f} m/s; within 5 cm "
                  f"{100 * np.mean(off[:, 1] < 0.05):3.0f} %, 0.15 m/s "
                  f"{100 * np.mean(off[:, 2] < 0.15):3.0f} %", flush=True)


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Run the rows that are named."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", metavar="|".join(ROWS), help="part of the name")
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    for name, options in ROWS.items():
        if given.rows and not any(word in name for word in given.rows):
            continue
        errors = Errors()
        seed = given.first
        done = 0
        while done < given.seeds:
            try:
                found = scene(seed, **options)
            except AssertionError:
                seed += 1
                continue
            evaluate(found, errors)
            done += 1
            seed += 1
        report(name, errors)


if __name__ == "__main__":
    main()
