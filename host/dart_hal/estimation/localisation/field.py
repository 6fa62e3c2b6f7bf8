"""A map that can be matched: its lines, and on a raster the distance to the nearest of them.

A thin wall has its zero on both sides alike, so the field is the plain distance to the lines,
bilinear between nodes 2.5 cm apart: on a straight wall exact but within half a cell of it, where
the fold of the distance is cut flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.boxes import walls_of
from dart_hal.estimation.localisation.grid import Grid, lines_of_grid

CELL = 0.025
"""m between two nodes: the c of the weights in the matcher is three of them."""
REACH = 0.6
"""m beyond which a distance is no news: the matcher ignores what is further than 0.5 m."""
MOST = 4_000_000
"""Nodes: 2500 m2, 128 MB. A larger map wants coarser cells."""


@dataclass(frozen=True, slots=True, eq=False)
class Map:
    """lines (m, 4): x1, y1, x2, y2 [m]; walls (k, 4): those that stay when boxes are carried off;
    origin (2,) [m] of node 0, 0; distance (rows, columns)
    [m], at most ``REACH``, which it is along the border; patch (rows * columns, 4): of the cell
    right above a node, the distance there and what x, y and x y add to it."""

    lines: FloatArray
    walls: FloatArray
    origin: FloatArray
    cell: float
    distance: FloatArray
    patch: FloatArray

    def look(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance (n,) [m] at places (n,) [m] and how it grows with x and y; flat far outside."""
        rows, columns = self.distance.shape
        u, v = (x - self.origin[0]) / self.cell, (y - self.origin[1]) / self.cell
        for w, n in ((u, columns), (v, rows)):
            np.maximum(w, 0.0, out=w)
            np.minimum(w, n - 1.001, out=w)
        i, j = u.astype(np.intp), v.astype(np.intp)
        u -= i
        v -= j
        here, by_x, by_y, by_xy = self.patch.take(j * columns + i, axis=0).T
        grow_x, grow_y = by_x + by_xy * v, by_y + by_xy * u
        return here + by_x * u + grow_y * v, grow_x / self.cell, grow_y / self.cell


def map_of_lines(lines: FloatArray, cell: float = CELL) -> Map:
    """The map of exact lines (m, 4) [m]. Raises UsageError for none, and for too many nodes."""
    lines, low, (rows, columns) = _raster(lines, cell)
    distance = np.full((rows, columns), REACH)
    for line in lines:
        _draw(distance, line, low, cell)
    walls = walls_of(lines, low, cell, distance)
    return Map(lines, walls, low, cell, distance, _patches(distance))


def map_of_pieces(lines: FloatArray, cell: float = CELL) -> Map:
    """The map of many lines (m, 4) [m] no longer than a few cells, five times quicker: of each
    node the distance to the piece whose middle is nearest; nothing in it is a box. Raises as
    ``map_of_lines``."""
    from scipy.ndimage import distance_transform_edt

    lines, low, shape = _raster(lines, cell)
    nearest = np.full(shape, -1)
    column, row = np.round((0.5 * (lines[:, :2] + lines[:, 2:]) - low) / cell).astype(int).T
    nearest[row, column] = np.arange(len(lines))
    far, (row, column) = distance_transform_edt(nearest < 0, cell, return_indices=True)
    distance = np.full(shape, REACH)
    j, i = np.nonzero(far < REACH + 2.0 * cell)
    node = low + cell * np.column_stack((i, j))
    near = _distance(node.T, lines[nearest[row[j, i], column[j, i]]].T)
    distance[j, i] = np.minimum(near, REACH)
    return Map(lines, lines, low, cell, distance, _patches(distance))


def _raster(lines: FloatArray, cell: float) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Lines (m, 4) for ever; where node 0, 0 is; rows and columns."""
    lines = np.asarray(lines, dtype=np.float64).reshape(-1, 4)
    if not len(lines):
        raise UsageError("a map without a wall", found="no line", expected="what a lidar sees")
    ends = lines.reshape(-1, 2)
    low = ends.min(axis=0) - REACH - 2.0 * cell
    columns, rows = np.ceil((ends.max(axis=0) + REACH + 2.0 * cell - low) / cell).astype(int) + 1
    if rows * columns > MOST:
        raise UsageError("a map too large to be matched", found=f"{columns} x {rows} nodes",
                         expected=f"at most {MOST}", remedy="cut it, or use coarser cells")
    lines.setflags(write=False)
    return lines, low, (int(rows), int(columns))


def map_of_grid(grid: Grid) -> Map:
    """The map of what is occupied in a ROS grid: the outlines of its cells."""
    return map_of_lines(lines_of_grid(grid), min(CELL, grid.cell))


def _draw(distance: FloatArray, line: FloatArray, low: FloatArray, cell: float) -> None:
    """Lower ``distance`` to that from ``line``, in the box that ``REACH`` puts around it."""
    first = np.floor((np.minimum(line[:2], line[2:]) - REACH - low) / cell).astype(int)
    last = np.ceil((np.maximum(line[:2], line[2:]) + REACH - low) / cell).astype(int) + 1
    box = distance[first[1]:last[1], first[0]:last[0]]
    x = low[0] + cell * np.arange(first[0], last[0])
    y = (low[1] + cell * np.arange(first[1], last[1]))[:, None]
    np.minimum(box, _distance((x, y), line), out=box)


def _distance(at: tuple[FloatArray, FloatArray] | FloatArray, line: FloatArray) -> FloatArray:
    """Of places x, y from lines x1, y1, x2, y2 [m], all of shapes that broadcast."""
    x, y, ex, ey = at[0] - line[0], at[1] - line[1], line[2] - line[0], line[3] - line[1]
    along = np.clip((x * ex + y * ey) / np.maximum(ex * ex + ey * ey, 1e-12), 0.0, 1.0)
    away: FloatArray = np.hypot(x - along * ex, y - along * ey)
    return away


def _patches(distance: FloatArray) -> FloatArray:
    """The bilinear form of each cell; of the last row and column flat."""
    d = np.pad(distance, ((0, 1), (0, 1)), mode="edge")
    here, right, above, across = d[:-1, :-1], d[:-1, 1:], d[1:, :-1], d[1:, 1:]
    forms = (here, right - here, above - here, across - right - above + here)
    return np.ascontiguousarray(np.stack(forms, axis=-1).reshape(-1, 4))
