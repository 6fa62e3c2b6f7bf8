"""A dense quadratic programme by the alternating direction method of multipliers.

    minimise  1/2 x' H x + g' x + sum_i w_i dist(C_i x, [low_i, high_i])

w_i = inf: a bound that holds; finite: one that may be passed at that price per unit. The splitting
is that of B. Stellato et al., "OSQP", Mathematical Programming Computation 12 (2020), without
sigma, as H is positive definite; a soft row is a proximal step, so it needs no variable of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray

RELAXATION = 1.6
# Iterations between two looks at the time.
EACH = 10


class Rows(NamedTuple):
    """Constraints: c (m, n), low, high (m,), price (m,), rho (m,)."""

    c: FloatArray
    low: FloatArray
    high: FloatArray
    price: FloatArray
    rho: FloatArray


class Splitting(NamedTuple):
    """What stays the same over the iterations: c (m, n), to_x (n, m), offset (n,), low, high, most
    (m,)."""

    c: FloatArray
    to_x: FloatArray
    offset: FloatArray
    low: FloatArray
    high: FloatArray
    most: FloatArray


# So many iterations on z and y (m,), in place.
Sweep = Callable[[int, Splitting, FloatArray, FloatArray], None]


def swept(times: int, of: Splitting, z: FloatArray, y: FloatArray) -> None:
    """See ``Sweep``; y is the dual by rho."""
    for _ in range(times):
        x = of.to_x @ (z - y) - of.offset
        there = RELAXATION * (of.c @ x) + (1.0 - RELAXATION) * z + y
        inside = np.minimum(np.maximum(there, of.low), of.high)
        beyond = there - inside
        z[:] = inside + beyond - np.minimum(np.maximum(beyond, -of.most), of.most)
        y[:] = there - z


def solve(
    h: FloatArray,
    g: FloatArray,
    rows: Rows,
    iterations: int,
    late: Callable[[], bool] = lambda: False,
    sweep: Sweep = swept,
) -> FloatArray | None:
    """x (n,) after so many iterations; None where ``late()`` before."""
    c, low, high, price, rho = rows
    weighted = c.T * rho
    inverse = np.linalg.inv(h + weighted @ c)
    of = Splitting(c, inverse @ weighted, inverse @ g, low, high, price / rho)
    z = np.clip(np.zeros(len(low)), low, high)
    y = np.zeros(len(low))
    for done in range(0, iterations, EACH):
        if late():
            return None
        sweep(min(EACH, iterations - done), of, z, y)
    x: FloatArray = of.to_x @ (z - y) - of.offset
    return x
