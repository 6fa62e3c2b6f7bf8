"""Hidden drives to be mapped, and how far what came of them is from the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.estimation.mapping.align import Alignment, align_points
from dart_hal.estimation.mapping.graph import relative_pose
from dart_hal.estimation.mapping.keyframes import Survey
from dart_hal.estimation.mapping.mapper import Mapper
from dart_lab.sim.lidar.maps import room_of
from studies.localisation.world import DT, Drive, Hidden, drive_along, wander

RADIUS = 0.8
"""m of its corners: 5 m/s2 at 2 m/s."""
EASE = 0.3
"""m over which the car steers into one."""
OVER = 6.0
"""m that are driven a second time."""


def around(seed: int, hid: Hidden) -> Drive:
    """Along the middle of the corridor, 38.6 m, and on."""
    rng = np.random.default_rng([seed, 8])
    room, step = room_of("corridor", seed), hid.speed * DT
    long, short = 12.0 - 2.0 * RADIUS, 8.0 - 2.0 * RADIUS
    corner = 0.5 * np.pi * RADIUS
    x, y, course = room.start
    begin = long + 1.0 + RADIUS - x
    ends = np.cumsum([begin, corner, short, corner, long, corner, short, corner, long])
    s = np.arange(0.0, ends[-2] + long - begin + OVER, step)
    bends = (np.searchsorted(ends, s) % 2) / RADIUS
    ease = max(round(EASE / step), 1)
    bends = np.convolve(bends, np.full(ease, 1.0 / ease), mode="same")
    courses = course + step * np.cumsum(bends)
    way: FloatArray = np.column_stack((x + step * np.cumsum(np.cos(courses)),
                                       y + step * np.cumsum(np.sin(courses)), courses, bends))
    return drive_along(room, way, hid, rng, seed)


def again(seed: int, hid: Hidden) -> Drive:
    """Another drive in the room of ``studies.localisation.world.drive``, boxes elsewhere."""
    rng = np.random.default_rng([seed, 12])
    room = room_of("room", seed)
    return drive_along(room, wander(room, hid.speed, hid.seconds, rng), hid, rng, seed)


def mapped(d: Drive, *, closing: bool = True, deskew: bool = True) -> Survey:
    """The survey of a drive."""
    mapper, k = Mapper(closing=closing, deskew=deskew), 0
    for scan in d.scans:
        while k < len(d.t) and d.t[k] <= scan.arrival:
            mapper.update_odometry(float(d.t[k]), *d.told[k].tolist())
            k += 1
        mapper.add(scan)
    return mapper.finish()


@dataclass(frozen=True)
class Placed:
    """A survey laid onto the truth as a whole: path, true (n, 3) in the room at the end of each
    scan; ``room`` takes points (n, 2) of the survey's frame into the room."""

    path: FloatArray
    true: FloatArray
    by: Alignment

    def room(self, points: FloatArray) -> FloatArray:
        return self.by.transform(points)

    def survey(self, points: FloatArray) -> FloatArray:
        """The other way."""
        c, s = np.cos(self.by.turn), np.sin(self.by.turn)
        back: FloatArray = (points - self.by.shift) @ np.array(((c, -s), (s, c)))
        return back

    @property
    def off(self) -> FloatArray:
        """Distance (n,) [m] of the path from the true one."""
        away: FloatArray = np.hypot(*(self.path - self.true)[:, :2].T)
        return away


def placed_on(survey: Survey, d: Drive, late: float = 0.010) -> Placed:
    """At the true times of the scans, whatever was learnt of ``late``."""
    path, last = survey.path(), np.array([float(scan.t[-1]) for scan in d.scans])
    told = last[np.abs(last - late - path[:, :1]).argmin(axis=1)]
    true = np.array([d.true(t - late) for t in told])
    by = align_points(path[:, 1:3], true[:, :2])
    return Placed(np.column_stack((by.transform(path[:, 1:3]), path[:, 3] + by.turn)), true, by)


def gap(placed: Placed, way: float = 3.0) -> tuple[float, float]:
    """How far a loop is from closed: rms distance [m] and turn [rad] by which where the car is the
    second time, seen from where it was the first, is told wrongly."""
    gone = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(placed.true[:, :2], axis=0).T))))
    off, turn = [], []
    for k in np.flatnonzero(gone > gone[-1] - OVER):
        before = np.flatnonzero(gone < gone[k] - way - OVER)
        j = before[np.argmin(np.hypot(*(placed.true[before, :2] - placed.true[k, :2]).T))]
        told, true = (relative_pose(p[j], p[k]) for p in (placed.path, placed.true))
        off.append(np.hypot(*(told - true)[:2]))
        turn.append((told[2] - true[2] + np.pi) % (2.0 * np.pi) - np.pi)
    return float(np.sqrt(np.mean(np.square(off)))), float(np.sqrt(np.mean(np.square(turn))))


def walls(grid: Grid, placed: Placed, lines: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance (n,) [m] of the middle of each occupied cell from the nearest line, and which."""
    row, column = np.nonzero(grid.occupied)
    at = placed.room(grid.origin + (np.column_stack((column, row)) + 0.5) * grid.cell)
    a, e = lines[:, :2], lines[:, 2:] - lines[:, :2]
    from_a = at[:, None] - a
    along = np.clip((from_a * e).sum(axis=2) / (e * e).sum(axis=1), 0.0, 1.0)
    away = np.linalg.norm(from_a - along[:, :, None] * e, axis=2)
    nearest = away.argmin(axis=1)
    return away.min(axis=1), nearest
