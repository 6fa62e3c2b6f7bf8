"""Figures of maps of hidden drives; docs/how_to/mapping.md shows them.

    python -m studies.mapping.figures --first 6000 --seeds 8              all, some 15 minutes
    python -m studies.mapping.figures --first 6000 --seeds 8 ring

rooms: random rooms of 6 x 5 m driven once, 60 s, another car about; walls are the occupied cells of
2 cm, and a second drive of another hidden car, boxes elsewhere, is localised on the map as written
and read. ring: once around the corridor of 14 x 10 m and 6 m on; a loop is closed where the car
knows to 1 cm and 0.3 deg where it is the second time, seen from the first.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dart_hal.estimation.localisation.field import map_of_grid
from dart_hal.estimation.localisation.grid import Grid, read_grid, write_grid
from dart_hal.estimation.localisation.localiser import Localiser
from dart_hal.estimation.mapping.occupancy import grid_of
from studies.localisation.figures import rms
from studies.localisation.world import Drive, drive, hidden
from studies.mapping.world import again, around, gap, mapped, placed_on, walls

CLOSED, TURNED = 0.01, np.radians(0.3)
"""m and rad: half a cell of the map, and what that is at 2 m."""


def outer(d: Drive) -> np.ndarray:
    """Which lines are outer walls."""
    ends = d.room.lines.reshape(-1, 2)
    low, high = ends.min(axis=0), ends.max(axis=0)
    a, b = d.lines[:, :2], d.lines[:, 2:]
    flags: np.ndarray = (((a == low) & (b == low)) | ((a == high) & (b == high))).any(axis=1)
    return flags


def written(grid: Grid) -> Grid:
    """As the file has it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.yaml"
        write_grid(grid, path)
        return read_grid(path)


def localised(grid: Grid, d: Drive, placed) -> np.ndarray:
    """Distances [m] of the poses of a drive, localised in a map that is placed in its room.

    Where it begins is told to 5 cm: boxes of the map have moved, which a search takes for another
    room.
    """
    x, y, yaw = d.truth[0]
    here = placed.survey(np.array([[x, y]]))[0] + 0.05
    local, k, off = Localiser(map_of_grid(grid), (*here, yaw - placed.by.turn)), 0, []
    for scan in d.scans:
        while k < len(d.t) and d.t[k] <= scan.arrival:
            d.tell(local, k)
            k += 1
        told = local.add(scan)
        if told is not None and told.pose is not None:
            at = placed.room(np.array([[told.pose.x, told.pose.y]]))[0]
            off.append(np.hypot(*(at - d.true(told.t)[:2])))
    return np.array(off)


def rooms(first: int, seeds: int, speeds: tuple[float, ...] = (0.5, 1.0, 2.0)) -> None:
    for speed in speeds:
        rows, seed = [], first
        while len(rows) < seeds:
            try:
                d = drive(seed, hidden(seed, speed=speed))
                second = again(seed, hidden(seed + 500, speed=speed, seconds=30.0))
            except AssertionError:
                continue
            finally:
                seed += 1
            survey = mapped(d)
            placed, grid = placed_on(survey, d), written(grid_of(survey))
            off, which = walls(grid, placed, d.lines)
            away = localised(grid, second, placed)
            out = off[outer(d)[which]]
            rows.append((rms(placed.off), np.median(out), rms(out), (off > 0.02).mean(), rms(away),
                         away.max(), len(away) / len(second.scans), len(survey.closures)))
        table = np.array(rows)
        mean, worst = np.median(table, axis=0), table.max(axis=0)
        print(f"room {speed:g} m/s, n {len(rows)}, median (worst): path {100 * mean[0]:.2f} "
              f"({100 * worst[0]:.2f}) cm rms; outer walls {100 * mean[1]:.2f} "
              f"({100 * worst[1]:.2f}) cm in the median, {100 * mean[2]:.2f} "
              f"({100 * worst[2]:.2f}) rms; cells off by 2 cm {100 * mean[3]:.2f} "
              f"({100 * worst[3]:.2f}) %; localised "
              f"{100 * mean[4]:.2f} ({100 * worst[4]:.2f}) cm rms, max {100 * worst[5]:.1f}, "
              f"{100 * table[:, 6].min():.0f} % of the scans at least; {mean[7]:.0f} closures",
              flush=True)


def ring(first: int, seeds: int, speeds: tuple[float, ...] = (2.0, 1.0)) -> None:
    for name, fixed in (("", {}), (", gaps of 1 s, spin 60 %", {"gap": 1.0, "spin": 0.6})):
        for speed in speeds:
            drives = [around(s, hidden(s, speed=speed, other=False, **fixed))
                      for s in range(first, first + seeds)]
            for closing in (True, False):
                loops(f"ring {speed:g} m/s{name}{'' if closing else ', loops left open'}", drives,
                      closing=closing)


def loops(name: str, drives: list[Drive], **how: bool) -> None:
    rows = []
    for d in drives:
        survey = mapped(d, **how)
        placed = placed_on(survey, d)
        off, _ = walls(grid_of(survey), placed, d.lines)
        rows.append((*gap(placed), rms(placed.off), np.median(off), (off > 0.02).mean()))
    table = np.array(rows)
    closed = ((table[:, 0] < CLOSED) & (table[:, 1] < TURNED)).sum()
    mean, worst = np.median(table, axis=0), table.max(axis=0)
    print(f"{name}: closed {closed} of {len(rows)}; gap {100 * mean[0]:.2f} ({100 * worst[0]:.2f}) "
          f"cm, {np.degrees(mean[1]):.3f} ({np.degrees(worst[1]):.3f}) deg; path "
          f"{100 * mean[2]:.2f} ({100 * worst[2]:.2f}) cm rms; walls {100 * mean[3]:.2f} "
          f"({100 * worst[3]:.2f}) cm in the median; cells off by 2 cm {100 * mean[4]:.2f} "
          f"({100 * worst[4]:.2f}) %", flush=True)


def control(first: int, seeds: int) -> None:
    """Without de-skewing, 20 s at 1 m/s."""
    drives = [drive(s, hidden(s, seconds=20.0)) for s in range(first, first + seeds)]
    for deskew in (True, False):
        surveys = [(mapped(d, deskew=deskew), d) for d in drives]
        off = [rms(placed_on(survey, d).off) for survey, d in surveys]
        bad = [(walls(grid_of(s), placed_on(s, d), d.lines)[0] > 0.02).mean() for s, d in surveys]
        print(f"room 1 m/s, 20 s, {'' if deskew else 'no '}de-skewing, n {len(off)}: path "
              f"{100 * np.median(off):.2f} ({100 * max(off):.2f}) cm rms; cells off by 2 cm "
              f"{100 * np.median(bad):.2f} ({100 * max(bad):.2f}) %", flush=True)


ALL: dict[str, Callable[[int, int], None]] = {"rooms": rooms, "ring": ring, "control": control}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="|".join(ALL))
    parser.add_argument("--first", type=int, default=5000)
    parser.add_argument("--seeds", type=int, default=8)
    told = parser.parse_args()
    for name in told.parts or ALL:
        ALL[name](told.first, told.seeds)


if __name__ == "__main__":
    main()
