"""How far one car may go while another one is still to come: B_ab(s), computed once for two paths.

    B_ab(s) = min over s' >= s of the first s_b with |p_a(s') - p_b(s_b)| < D

One table for crossing, merging, a roundabout and following. It never falls with s, so an old s
of the other car only makes it stricter.
"""

from __future__ import annotations

from math import inf

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray


def point_distances(a: Path, b: Path) -> FloatArray:
    """Return the distances (n_a, n_b) [m] between the points of two paths."""
    dx = a.x[:, None] - b.x
    dy = a.y[:, None] - b.y
    dx *= dx
    dy *= dy
    dx += dy
    result: FloatArray = np.sqrt(dx, out=dx)
    return result


def stop_lines(distances: FloatArray, b: Path, min_distance: float) -> FloatArray:
    """Return B_ab [m] at the points of a; inf where b is free.

    distances: ``point_distances(a, b)``; min_distance [m]: D, between the centres of the cars. The
    line is one point before the first that is too near, so it also holds between two points.
    """
    is_near = distances < min_distance
    first = np.where(is_near.any(axis=1), b.s[is_near.argmax(axis=1)] - b.spacing, inf)
    result: FloatArray = np.minimum.accumulate(first[::-1])[::-1]
    return result
