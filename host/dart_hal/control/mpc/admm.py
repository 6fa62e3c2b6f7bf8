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

from dart_hal.types import FloatArray

RELAXATION = 1.6
EACH = 10
"""Iterations between two looks at the time."""


class Rows(NamedTuple):
    """Constraints: c (m, n), low, high (m,), price (m,), rho (m,)."""

    c: FloatArray
    low: FloatArray
    high: FloatArray
    price: FloatArray
    rho: FloatArray


def solve(
    h: FloatArray,
    g: FloatArray,
    rows: Rows,
    iterations: int,
    late: Callable[[], bool] = lambda: False,
) -> FloatArray | None:
    """x (n,) after so many iterations; None where ``late()`` before."""
    c, low, high, price, rho = rows
    weighted = c.T * rho
    inverse = np.linalg.inv(h + weighted @ c)
    to_x, offset = inverse @ weighted, inverse @ g
    most = price / rho
    z, y = np.clip(np.zeros(len(low)), low, high), np.zeros(len(low))  # y: dual by rho
    for k in range(iterations):
        if k % EACH == 0 and late():
            return None
        there = RELAXATION * (c @ (to_x @ (z - y) - offset)) + (1.0 - RELAXATION) * z + y
        inside = np.minimum(np.maximum(there, low), high)
        beyond = there - inside
        z = inside + beyond - np.minimum(np.maximum(beyond, -most), most)
        y = there - z
    x: FloatArray = to_x @ (z - y) - offset
    return x
