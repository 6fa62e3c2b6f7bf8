"""Where rays meet lines: exactly, by numpy, or by C (``rays.c``) where there is a compiler."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.native import function

FAR = 1e9
"""m: a ray that meets nothing."""
SLACK = 1e-9
"""Share of a line by which it is longer at both ends: no ray slips through a corner."""
AT_ONCE = 200_000
"""Pairs of ray and line that numpy holds at once: three arrays of 1.6 MB."""

Cast = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""``cast(lines, origin, direction)``: lines (m, 4) as x1, y1, x2, y2 [m], origin (n, 2) [m],
direction (n, 2) of length 1; the distance (n,) [m] to the first line, ``FAR`` without one."""


def cast_numpy(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """``Cast`` by numpy, all pairs of a slice of the rays at once."""
    out = np.full(len(origin), FAR)
    if len(lines):
        some = max(AT_ONCE // len(lines), 1)
        for k in range(0, len(origin), some):
            out[k:k + some] = _pairs(lines, origin[k:k + some], direction[k:k + some])
    return out


def _pairs(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Cramer's rule for a + u e = o + t d; its determinants are products of two matrices."""
    ax, ay, bx, by = lines.T
    ex, ey, one = bx - ax, by - ay, np.ones(len(origin))
    (ox, oy), (dx, dy) = origin.T, direction.T
    den = direction @ np.array((ey, -ex))
    den[den == 0.0] = 1e-300
    t = np.column_stack((ox, oy, one)) @ np.array((-ey, ex, ax * ey - ay * ex))
    u = np.column_stack((dy, -dx, ox * dy - oy * dx)) @ np.array((ax, ay, -np.ones(len(ax))))
    with np.errstate(over="ignore"):
        t /= den
        u /= den
    u -= 0.5
    np.abs(u, out=u)
    aside = u > 0.5 + SLACK
    aside |= t <= 0.0
    np.putmask(t, aside, FAR)
    nearest: FloatArray = np.minimum(t.min(axis=1), FAR)
    return nearest


@lru_cache(maxsize=1)
def native() -> Cast | None:
    """``Cast`` by C; None where it cannot be had, or says something else than numpy."""
    compiled = function("cast", "rays.c")
    if compiled is None:
        return None
    number, address = ctypes.c_int64, ctypes.c_void_p
    compiled.argtypes = [number, number, ctypes.c_double, ctypes.c_double, *[address] * 9]

    def cast(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
        ends = np.array(lines.T, dtype=np.float64, order="C")
        ends[2:] -= ends[:2]
        columns = [*np.array(origin.T, order="C"), *np.array(direction.T, order="C"), *ends]
        out = np.empty(len(origin))
        compiled(len(origin), len(lines), FAR, SLACK, *[c.ctypes.data for c in columns],
                 out.ctypes.data)
        return out

    return cast if _agrees(cast) else None


def _agrees(cast: Cast) -> bool:
    rng = np.random.default_rng(1)
    lines, origin = rng.uniform(-5.0, 5.0, (40, 4)), rng.uniform(-5.0, 5.0, (200, 2))
    turn = rng.uniform(-np.pi, np.pi, 200)
    direction = np.column_stack((np.cos(turn), np.sin(turn)))
    return bool(np.allclose(cast(lines, origin, direction),
                            cast_numpy(lines, origin, direction), rtol=1e-12, atol=1e-12))


def best() -> Cast:
    """The fastest that there is."""
    return native() or cast_numpy
