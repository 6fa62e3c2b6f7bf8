"""Separate the walls of a map from movable boxes: the small parts that touch no other."""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

# m, both sides of the bounding box of such a part: a box of 0.5 m, turned.
MAX_BOX_SIZE = 0.8


def select_walls(
    lines: FloatArray, origin: FloatArray, cell: float, distance: FloatArray
) -> FloatArray:
    """Return the lines (k, 4) [m] without boxes; parts closer than two nodes touch.

    origin (2,) [m] of node 0, 0; distance (rows, columns) [m] of nodes with a spacing of ``cell``
    [m].
    """
    from scipy.ndimage import find_objects, label

    parts, _ = label(distance < cell, np.ones((3, 3)))
    small = [False] + [
        max(rows.stop - rows.start, columns.stop - columns.start) * cell < MAX_BOX_SIZE
        for rows, columns in find_objects(parts)
    ]
    middle = 0.5 * (lines[:, :2] + lines[:, 2:]) - origin
    column, row = np.round(middle / cell).astype(int).T
    walls: FloatArray = lines[~np.array(small)[parts[row, column]]]
    return walls
