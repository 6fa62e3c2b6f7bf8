"""How far one car may go while another is still to come: B_ab(s), made once for two paths.

    B_ab(s) = min over s' >= s of the first s_b with |p_a(s') - p_b(s_b)| < D

One table for crossing, merging, a roundabout and following. It never falls with s, so a stale s
of the other car only makes it stricter.
"""

from __future__ import annotations

from math import inf

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray


def distances(a: Path, b: Path) -> FloatArray:
    """(n_a, n_b) [m] between their points."""
    dx = a.x[:, None] - b.x
    dy = a.y[:, None] - b.y
    dx *= dx
    dy *= dy
    dx += dy
    apart: FloatArray = np.sqrt(dx, out=dx)
    return apart


def lines(between: FloatArray, b: Path, apart: float) -> FloatArray:
    """B_ab [m] at the points of a; inf where b is free.

    between: ``distances(a, b)``; apart [m]: D, between the cars' middles. The line lies a point
    before the first that is too near, so that a car between two points counts as at either.
    """
    near = between < apart
    first = np.where(near.any(axis=1), b.s[near.argmax(axis=1)] - b.spacing, inf)
    after: FloatArray = np.minimum.accumulate(first[::-1])[::-1]
    return after
