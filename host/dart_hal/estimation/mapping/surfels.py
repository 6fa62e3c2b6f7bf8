"""Surfels: short wall lines from the points of scans, for the matcher.

Noise spreads a wall over 5 cm. Each cell gives one line: through the mean of its points, moved onto
the best fit of the points in the 3 x 3 cells around it. So cells on both sides of a wall lie on one
line, and the field has its zero in the middle of the noise.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.field import Map, map_of_pieces

# m: a window of 3 cells is 8 sigma of a distance wide, and shorter than a side of a box.
SURFEL_CELL = 0.04
# m: the same where the noise grows with distance, by 1 % to 5 cm in 5 m.
WIDE_SURFEL_CELL = 0.08
# Points of a window from which on it has a direction.
MIN_WINDOW_POINTS = 3
# Length of a line in cells: the diagonal of its own, so that no ray passes between.
SURFEL_LENGTH = 1.5


def lines_of_points(points: FloatArray, cell: float = SURFEL_CELL) -> FloatArray:
    """Fit lines (m, 4) as x1, y1, x2, y2 [m] to points (n, 2) [m] by cells [m].

    1. Sums of 1, x, y and their products in each cell and in its 3 x 3 window.
    2. Direction of the largest spread in the window.
    3. Mean of the cell, projected onto the line through the mean of the window.
    """
    low = points.min(axis=0) - 2.0 * cell
    column, row = ((points.T - low[:, None]) / cell).astype(int)
    columns = int(column.max()) + 2
    rows = int(row.max()) + 2
    index = row * columns + column
    x, y = points.T - low[:, None]

    def summed(weight: FloatArray) -> FloatArray:
        cells = np.bincount(index, weight, rows * columns).reshape(rows, columns)
        return np.asarray(cells, dtype=np.float64)

    sums = np.stack([summed(w) for w in (np.ones(len(x)), x, y, x * x, x * y, y * y)])
    around = _window(sums)
    j, i = np.nonzero((sums[0, 1:-1, 1:-1] > 0.0) & (around[0] >= MIN_WINDOW_POINTS))
    mx, my, xx, xy, yy = around[1:, j, i] / around[0, j, i]
    turn = 0.5 * np.arctan2(2.0 * (xy - mx * my), (xx - mx * mx) - (yy - my * my))
    c = np.cos(turn)
    s = np.sin(turn)
    own = sums[1:3, j + 1, i + 1] / sums[0, j + 1, i + 1]
    along = c * (own[0] - mx) + s * (own[1] - my)
    x = low[0] + mx + along * c
    y = low[1] + my + along * s
    half = 0.5 * SURFEL_LENGTH * cell
    return np.column_stack((x - half * c, y - half * s, x + half * c, y + half * s))


def chart_of_points(points: FloatArray, cell: float = SURFEL_CELL) -> Map:
    """Return the map for ``match`` of points (n, 2) [m]."""
    return map_of_pieces(lines_of_points(points, cell))


def _window(cells: FloatArray) -> FloatArray:
    """Sums over 3 x 3 of the inner cells (k, rows - 2, columns - 2)."""
    level = cells[:, :-2] + cells[:, 1:-1] + cells[:, 2:]
    summed: FloatArray = level[:, :, :-2] + level[:, :, 1:-1] + level[:, :, 2:]
    return summed
