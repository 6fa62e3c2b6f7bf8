"""Distances from points along rays to the first line: exact, in NumPy or C (``rays.c``)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.native import load_function

# m: distance of a ray that meets no line.
NO_HIT = 1e9
# Share of a line by which it is extended at both ends, so that no ray passes a corner.
LINE_EXTENSION = 1e-9
# Pairs of ray and line per block of NumPy: three arrays of 1.6 MB.
MAX_PAIRS = 200_000

Cast = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""``cast(lines, origin, direction)``: lines (m, 4) as x1, y1, x2, y2 [m], origin (n, 2) [m],
direction (n, 2) of length 1; the distance (n,) [m] to the first line, ``NO_HIT`` without one."""


def cast_numpy(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Implement ``Cast`` in NumPy, block by block of rays."""
    out = np.full(len(origin), NO_HIT)
    if len(lines):
        some = max(MAX_PAIRS // len(lines), 1)
        for k in range(0, len(origin), some):
            out[k:k + some] = _cast_block(lines, origin[k:k + some], direction[k:k + some])
    return out


def _cast_block(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Solve a + u e = o + t d by Cramer's rule; its determinants are matrix products."""
    ax, ay, bx, by = lines.T
    ex = bx - ax
    ey = by - ay
    one = np.ones(len(origin))
    (ox, oy) = origin.T
    (dx, dy) = direction.T
    den = direction @ np.array((ey, -ex))
    den[den == 0.0] = 1e-300
    t = np.column_stack((ox, oy, one)) @ np.array((-ey, ex, ax * ey - ay * ex))
    u = np.column_stack((dy, -dx, ox * dy - oy * dx)) @ np.array((ax, ay, -np.ones(len(ax))))
    with np.errstate(over="ignore"):
        t /= den
        u /= den
    u -= 0.5
    np.abs(u, out=u)
    misses = u > 0.5 + LINE_EXTENSION
    misses |= t <= 0.0
    np.putmask(t, misses, NO_HIT)
    nearest: FloatArray = np.minimum(t.min(axis=1), NO_HIT)
    return nearest


@lru_cache(maxsize=1)
def native_cast() -> Cast | None:
    """Return ``Cast`` in C; None if not available, or different from NumPy."""
    compiled = load_function("cast", "rays.c")
    if compiled is None:
        return None
    number = ctypes.c_int64
    address = ctypes.c_void_p
    compiled.argtypes = [number, number, ctypes.c_double, ctypes.c_double, *[address] * 9]

    def cast(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
        ends = np.array(lines.T, dtype=np.float64, order="C")
        ends[2:] -= ends[:2]
        columns = [*np.array(origin.T, order="C"), *np.array(direction.T, order="C"), *ends]
        out = np.empty(len(origin))
        compiled(len(origin), len(lines), NO_HIT, LINE_EXTENSION, *[c.ctypes.data for c in columns],
                 out.ctypes.data)
        return out

    return cast if _is_equal(cast) else None


def _is_equal(cast: Cast) -> bool:
    """Compare with NumPy on random rays and lines."""
    rng = np.random.default_rng(1)
    lines = rng.uniform(-5.0, 5.0, (40, 4))
    origin = rng.uniform(-5.0, 5.0, (200, 2))
    turn = rng.uniform(-np.pi, np.pi, 200)
    direction = np.column_stack((np.cos(turn), np.sin(turn)))
    return bool(np.allclose(cast(lines, origin, direction),
                            cast_numpy(lines, origin, direction), rtol=1e-12, atol=1e-12))


def fastest_cast() -> Cast:
    """Return the fastest implementation available."""
    return native_cast() or cast_numpy
