"""The ray caster of f1tenth_gym (``laser_models.get_scan``), rewritten with its operations.

Sphere tracing on a grid: a beam advances by the distance to the nearest occupied cell until this
is below 0.1 mm. As in the original, numba compiles it, and the grid may be turned and has a cell
size that is not a constant. f1tenth_gym itself is not on the package index.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Scan = Callable[[float, float], "np.ndarray[Any, Any]"]
# m: cell, step at which a beam ends, and range of the original.
CELL = 0.05
MIN_STEP = 1e-4
RANGE = 30.0
# Directions in the table of sines.
DIRECTIONS = 2000


def make_sphere_tracer(lines: np.ndarray[Any, Any], beams: int) -> Scan | None:
    """Return a function that scans a full turn from x, y [m]; None without numba."""
    try:
        from numba import njit
    except ImportError:
        return None
    from scipy.ndimage import distance_transform_edt

    low = lines.reshape(-1, 2).min(axis=0) - 2.0 * CELL
    high = lines.reshape(-1, 2).max(axis=0) + 2.0 * CELL
    columns, rows = np.ceil((high - low) / CELL).astype(int).tolist()
    occupied = np.zeros((rows, columns), dtype=bool)
    for line in lines:
        share = np.linspace(0.0, 1.0, int(np.hypot(*(line[2:] - line[:2])) / (0.1 * CELL)) + 2)
        places = line[:2] + share[:, None] * (line[2:] - line[:2])
        column, row = ((places - low) / CELL).astype(int).T
        occupied[row, column] = True
    distance = CELL * distance_transform_edt(~occupied)
    angle = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS)
    sines = np.sin(angle)
    cosines = np.cos(angle)

    @njit
    def find_cell(x, y, left, low, c, s, rows, columns, cell):
        dx = x - left
        dy = y - low
        u = dx * c + dy * s
        v = -dx * s + dy * c
        if u < 0 or u >= columns * cell or v < 0 or v >= rows * cell:
            return -1, -1
        return int(v / cell), int(u / cell)

    @njit
    def trace(x, y, index, place, table, tables):
        left, low, c, s, rows, columns, cell = place
        sine = tables[0][int(index)]
        cosine = tables[1][int(index)]
        row, column = find_cell(x, y, left, low, c, s, rows, columns, cell)
        step = table[row, column]
        total = step
        while step > MIN_STEP and total <= RANGE:
            x += step * cosine
            y += step * sine
            row, column = find_cell(x, y, left, low, c, s, rows, columns, cell)
            step = table[row, column]
            total += step
        return min(total, RANGE)

    @njit
    def scan(x, y, place, table, tables):
        out = np.empty(beams)
        index = 0.0
        for k in range(beams):
            out[k] = trace(x, y, index, place, table, tables)
            index += DIRECTIONS / beams
            while index >= DIRECTIONS:
                index -= DIRECTIONS
        return out

    place = (*low.tolist(), 1.0, 0.0, rows, columns, CELL)
    return lambda x, y: scan(x, y, place, distance, (sines, cosines))
