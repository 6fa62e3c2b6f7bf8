"""What somebody may carry off: the small parts of a map that touch no other."""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

LARGEST = 0.8
"""m, both sides of what stands around such a part, along x and y: a box of 0.5 m, turned."""


def walls_of(
    lines: FloatArray, origin: FloatArray, cell: float, distance: FloatArray
) -> FloatArray:
    """Lines (k, 4) [m] without the boxes among them; parts nearer than two nodes touch.

    origin (2,) [m] of node 0, 0; distance (rows, columns) [m] of nodes ``cell`` [m] apart.
    """
    from scipy.ndimage import find_objects, label

    parts, _ = label(distance < cell, np.ones((3, 3)))
    small = [False] + [
        max(rows.stop - rows.start, columns.stop - columns.start) * cell < LARGEST
        for rows, columns in find_objects(parts)
    ]
    middle = 0.5 * (lines[:, :2] + lines[:, 2:]) - origin
    column, row = np.round(middle / cell).astype(int).T
    walls: FloatArray = lines[~np.array(small)[parts[row, column]]]
    return walls
