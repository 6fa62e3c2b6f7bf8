"""Figures of the localiser on hidden drives in random rooms; docs/how_to/localising.md shows them.

    python -m studies.localisation.figures --first 6000 --seeds 20             all, half an hour
    python -m studies.localisation.figures --first 6000 --seeds 20 track flags

Each row: n poses, rms and greatest distance [cm], worst rms of a seed, yaw rms and greatest [deg],
mean normalised error squared (1 when honest). Rooms without a way at 2 m/s are passed over.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dart_hal.estimation.localisation.belief import start_belief
from dart_hal.estimation.localisation.field import NODE_SPACING, map_of_grid, map_of_lines
from dart_hal.estimation.localisation.grid import lines_of_grid
from dart_hal.estimation.localisation.health import Status, TrackJudge
from dart_hal.estimation.localisation.localiser import MIN_PROOF_SCANS, Localiser
from dart_hal.estimation.localisation.search import search
from studies.localisation.world import Drive, Hidden, Result, draw_in_cells, drive, hidden, run

ROWS: dict[str, dict[str, float]] = {
    "0.5 m/s": {"speed": 0.5}, "1 m/s": {}, "2 m/s": {"speed": 2.0},
    "1 m/s, stale 22 %": {"stale": 0.22},
    "1 m/s, stale 22 %, 2 of 4 boxes gone": {"stale": 0.22, "gone": 2},
    "1 m/s, noise 1 cm + 1 %, stale 22 %, 30 ms late": {
        "noise": 0.01, "noise_share": 0.01, "stale": 0.22, "late": 0.03},
    "1 m/s, distances 1.5 % short": {"scale": 1.015},
    "1 m/s, gaps of 1 s, spin 60 %": {"gap": 1.0, "spin": 0.6},
    "2 m/s, gaps of 1 s, spin 60 %": {"gap": 1.0, "spin": 0.6, "speed": 2.0},
}


def drives(first: int, seeds: int, **fixed: float) -> Iterator[tuple[int, Hidden, Drive]]:
    """Of the first seeds in whose rooms there is a way."""
    seed = first
    while seeds:
        hid = hidden(seed, **fixed)
        try:
            yield seed, hid, drive(seed, hid)
            seeds -= 1
        except AssertionError:
            pass
        seed += 1


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def row(name: str, results: list[Result]) -> None:
    off, yaw = (np.concatenate([getattr(r, k) for r in results]) for k in ("off", "yaw"))
    worst = max(rms(r.off) for r in results)
    nees = np.concatenate([r.nees for r in results]).mean()
    print(f"{name:50s} n {len(off):6d}  {100 * rms(off):5.2f} (worst {100 * worst:5.2f}) max "
          f"{100 * off.max():5.2f} cm  yaw {np.degrees(rms(yaw)):.3f} max "
          f"{np.degrees(np.abs(yaw).max()):.2f} deg  NEES {nees:.2f}", flush=True)


def track(first: int, seeds: int) -> None:
    for name, fixed in ROWS.items():
        row(name, [run(d, late=h.late) for _, h, d in drives(first, seeds, **fixed)])


def cells(first: int, seeds: int) -> None:
    """On maps in cells, at 1 m/s for 20 s, by the middles and by the outlines of the cells."""
    for cell in (0.01, 0.02, 0.05):
        by_middles, by_outlines = [], []
        for seed, h, d in drives(first, seeds, seconds=20.0):
            grid = draw_in_cells(d.room.lines, cell, np.random.default_rng([seed, 33]))
            outlines = map_of_lines(lines_of_grid(grid), min(NODE_SPACING, cell))
            by_middles.append(run(replace(d, chart=map_of_grid(grid)), late=h.late))
            by_outlines.append(run(replace(d, chart=outlines), late=h.late))
        row(f"cells of {100 * cell:g} cm, their middles", by_middles)
        row(f"cells of {100 * cell:g} cm, outlines", by_outlines)


def control(first: int, seeds: int) -> None:
    """Without de-skewing, by the better of the single stamps: 20 s, while the car is not lost."""
    for speed in (1.0, 2.0):
        for deskew in (True, False):
            results = [run(d, deskew=deskew, until_lost=True)
                       for _, _, d in drives(first, seeds, speed=speed, seconds=20.0)]
            row(f"{speed:g} m/s, {'' if deskew else 'no '}de-skewing", results)


def cpu(first: int, seeds: int) -> None:
    """Time of each scan [ms], the States before it included."""
    spent = []
    for _, _, d in drives(first, min(seeds, 4)):
        local, k = Localiser(d.chart, tuple(d.true(float(d.scans[0].t[-1])).tolist())), 0
        for scan in d.scans:
            while k < len(d.t) and d.t[k] <= scan.arrival:
                d.tell(local, k)
                k += 1
            begin = time.process_time()
            local.add(scan)
            spent.append(time.process_time() - begin)
    print(f"CPU a scan: median {1e3 * np.median(spent):.2f}, p95 "
          f"{1e3 * np.quantile(spent, 0.95):.2f} ms, n {len(spent)}")


def flags(first: int, seeds: int) -> None:
    """Poses wrong by 0.3 to 1.5 m and 0.3 to 3 rad, put into a good track: how soon lost."""
    for stale, gone in ((0.07, 0), (0.22, 0), (0.22, 2), (0.22, 4)):
        counts = [wrongs(seed, d) for seed, _, d in drives(first, seeds, stale=stale, gone=gone)]
        healed, lost, missed, false, scans = np.sum(counts, axis=0)
        print(f"stale {stale:.0%}, {gone} boxes gone: wrong poses {healed + lost + missed}: "
              f"healed {healed}, lost within 3 scans {lost}, not {missed}; false losses {false} "
              f"of {scans} scans", flush=True)


def wrongs(seed: int, d: Drive) -> list[int]:
    """Of wrong poses, one in 12 scans: pulled right within 3, lost, neither; of good ones: given
    up, of how many."""
    seen, rng, good = [0, 0, 0], np.random.default_rng([seed, 9]), run(d)
    told = [s for s in good.told if s]
    for k in range(30, len(d.scans) - 12, 12):
        local = _warmed(d, k)
        mean = local._judge.mean
        way, turn = rng.uniform(0.3, 1.5), rng.uniform(0.3, 3.0) * rng.choice((-1, 1))
        course, t = rng.uniform(-np.pi, np.pi), float(d.scans[k].t[-1]) - 0.01
        wrong = d.true(t) + np.array((way * np.cos(course), way * np.sin(course), turn))
        local.belief, local._learnt = start_belief(t, wrong), None
        local._judge, local._proof_scans = TrackJudge(mean), MIN_PROOF_SCANS
        judge_wrong(d, local, k, seen)
    return [*seen, sum(s.status is Status.LOST for s in told), len(told)]


def _warmed(d: Drive, k: int) -> Localiser:
    """A localiser that has the odometry around scan k, and its agreement there."""
    local = Localiser(d.chart, tuple(d.true(float(d.scans[k].t[-1]) - 0.01).tolist()))
    for j in np.flatnonzero((d.t > d.scans[k].t[0] - 0.5) & (d.t <= d.scans[k].arrival)):
        d.tell(local, int(j))
    seen = local.add(d.scans[k])
    assert seen is not None
    local._judge = TrackJudge(seen.agreement)
    return local


def judge_wrong(d: Drive, local: Localiser, k: int, seen: list[int]) -> None:
    """Count: 0 the pose was pulled right within 3 scans, 1 said to be lost, 2 neither."""
    for scan in d.scans[k + 1:k + 4]:
        for j in np.flatnonzero((d.t > d.scans[k].arrival) & (d.t <= scan.arrival)):
            d.tell(local, int(j))
        told = local.add(scan)
        if told is None or told.status is Status.LOST:
            seen[1] += 1
            return
    if told.pose is None:
        seen[2] += 1
        return
    true = d.true(told.t)
    off = np.hypot(told.pose.x - true[0], told.pose.y - true[1])
    turn = abs((told.pose.yaw - true[2] + np.pi) % (2 * np.pi) - np.pi)
    seen[0 if off < 0.1 and turn < 0.1 else 2] += 1


def starts(first: int, seeds: int) -> None:
    """Global starts by single scans: of the own room, of another, with a reversed rotation."""
    found = list(drives(first, seeds, seconds=50 * 0.61 + 3.0))
    for name in ("own room", "another room", "reversed rotation"):
        right = wrong = flagged = 0
        spent = []
        for at, (seed, hid, d) in enumerate(found):
            if name == "reversed rotation":
                d = drive(seed, hidden(seed, seconds=hid.seconds, sense=-1.0))
            chart = found[(at + 1) % len(found)][2].chart if name == "another room" else d.chart
            for k in range(4, min(4 + 5 * 50, len(d.scans)), 5):
                local = _warmed(d, k)
                beams = local._beams(d.scans[k])
                if beams is None:
                    continue
                begin = time.process_time()
                best = search(chart, beams.points, beams.rays, beams.origin)
                spent.append(time.process_time() - begin)
                if not (best.is_unique and best.is_known_room):
                    flagged += 1
                    continue
                true = d.true(float(beams.stretch.t[-1]))
                off = np.hypot(*(best.pose[:2] - true[:2]))
                turn = abs((best.pose[2] - true[2] + np.pi) % (2 * np.pi) - np.pi)
                fits = name == "own room" and off < 0.2 and turn < 0.1
                right, wrong = right + fits, wrong + (not fits)
        print(f"single scan, {name}: right {right}, flagged {flagged}, wrong {wrong}; "
              f"{1e3 * np.median(spent):.0f} ms of CPU", flush=True)


def whole(first: int, seeds: int) -> None:
    """Drives of 30 s without a known start: in its room, with all boxes of the map gone and 22 %
    new ones, in another, mirrored, kidnapped."""
    found = list(drives(first, seeds, seconds=30.0))
    for name in ("own room", "boxes moved", "another room", "reversed rotation", "kidnapped"):
        poses = wrong = scans = never = 0
        times = []
        for at, (seed, hid, d) in enumerate(found):
            if name == "reversed rotation":
                d = drive(seed, hidden(seed, seconds=hid.seconds, sense=-1.0))
            if name == "boxes moved":
                d = drive(seed, hidden(seed, seconds=hid.seconds, stale=0.22, gone=4))
            if name == "kidnapped":
                d = kidnapped(d)
            chart = found[(at + 1) % len(found)][2].chart if name == "another room" else d.chart
            r = run(d, known=False, localiser=Localiser(chart))
            told = [s for s in r.told if s]
            scans, poses = scans + len(told), poses + len(r.off)
            wrong += len(r.off) if name == "another room" else int((r.off > 0.2).sum())
            begin = 15.0 if name == "kidnapped" else d.t[0]
            back = [s.t - begin for s in told if s.pose and s.t > begin
                    and np.hypot(*(np.array((s.pose.x, s.pose.y)) - d.true(s.t)[:2])) < 0.2]
            times += back[:1]
            never += not back
        print(f"30 s, {name}: {scans} scans, {poses} poses, wrong ones {wrong}; first right after "
              f"{np.median(times) if times else np.nan:.2f} s in the median, "
              f"{max(times, default=np.nan):.2f} at the latest, never in {never} of {len(found)}",
              flush=True)


def kidnapped(d: Drive) -> Drive:
    """At 15 s the car goes on from where it was at 5 s, and neither wheels nor gyro tell."""
    cut, back = int(14.0 / 0.01), int(4.0 / 0.01)
    first = [s for s in d.scans if s.arrival < 15.0]
    again = [s for s in d.scans if float(s.t[0]) > 5.05 and s.arrival + 10.0 < 25.0]
    moved = [replace(s, arrival=s.arrival + 10.0, start=s.start + 10.0) for s in again]
    length = 1000
    truth = np.vstack((d.truth[:cut], d.truth[back:back + length]))
    later = d.told[back:back + length] - d.told[back]
    turn = d.told[cut - 1, 2] - d.told[back, 2]
    c, s = np.cos(turn), np.sin(turn)
    xy = later[:, :2] @ np.array(((c, s), (-s, c)))
    told = np.vstack((d.told[:cut], d.told[cut - 1] + np.column_stack((xy, later[:, 2]))))
    accel = np.concatenate((d.accel[:cut], d.accel[back:back + length]))
    return Drive(d.chart, d.room, d.t[:cut + length], truth, told, first + moved, accel, d.lines)


ALL = {"track": track, "cells": cells, "control": control, "cpu": cpu, "flags": flags,
       "starts": starts, "whole": whole}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="|".join(ALL))
    parser.add_argument("--first", type=int, default=5000)
    parser.add_argument("--seeds", type=int, default=20)
    told = parser.parse_args()
    for name in told.parts or ALL:
        ALL[name](told.first, told.seeds)


if __name__ == "__main__":
    main()
