"""A dense quadratic programme by the alternating direction method of multipliers.

    minimise  1/2 x' H x + g' x + sum_i w_i dist(C_i x, [low_i, high_i])

w_i = inf: a hard bound; finite: a soft bound with that price per unit of violation. The splitting
is that of B. Stellato et al., "OSQP", Mathematical Programming Computation 12 (2020), without
sigma, as H is positive definite. A soft row is a proximal step, so it needs no slack variable.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray

# alpha of the over-relaxation, as recommended for OSQP.
RELAXATION = 1.6
# Iterations between two readings of the clock.
ITERATIONS_PER_CLOCK_CHECK = 10


class Constraints(NamedTuple):
    """Rows low <= C x <= high: c (m, n), low, high (m,), price (m,), rho (m,)."""

    c: FloatArray
    low: FloatArray
    high: FloatArray
    price: FloatArray
    rho: FloatArray


class Splitting(NamedTuple):
    """Constants of the iterations: c (m, n), to_x (n, m), offset (n,), low, high, max_push (m,).

    max_push: largest shift by the price of a soft row, price / rho.
    """

    c: FloatArray
    to_x: FloatArray
    offset: FloatArray
    low: FloatArray
    high: FloatArray
    max_push: FloatArray


# Function that runs a number of iterations on z and y (m,), in place.
Sweep = Callable[[int, Splitting, FloatArray, FloatArray], None]


def run_sweep(iterations: int, splitting: Splitting, z: FloatArray, y: FloatArray) -> None:
    """Run ADMM iterations on z and y (m,) in place; y is the dual divided by rho.

    1. x = argmin of the Lagrangian, by the inverse of H + C' R C, made once in ``solve``.
    2. Over-relax: relaxed = alpha C x + (1 - alpha) z + y.
    3. Hard rows: z is the projection of relaxed onto [low, high]. Soft rows: the proximal step of
       price * distance moves relaxed towards the interval by max_push at the most.
    4. y = relaxed - z.
    """
    for _ in range(iterations):
        x = splitting.to_x @ (z - y) - splitting.offset
        relaxed = RELAXATION * (splitting.c @ x) + (1.0 - RELAXATION) * z + y
        inside = np.minimum(np.maximum(relaxed, splitting.low), splitting.high)
        excess = relaxed - inside
        push = np.minimum(np.maximum(excess, -splitting.max_push), splitting.max_push)
        z[:] = inside + excess - push
        y[:] = relaxed - z


def solve(
    h: FloatArray,
    g: FloatArray,
    constraints: Constraints,
    iterations: int,
    is_late: Callable[[], bool] = lambda: False,
    sweep: Sweep = run_sweep,
) -> FloatArray | None:
    """Return x (n,) after the iterations, or None if ``is_late()`` became true before their end."""
    c, low, high, price, rho = constraints
    weighted = c.T * rho
    inverse = np.linalg.inv(h + weighted @ c)
    splitting = Splitting(c, inverse @ weighted, inverse @ g, low, high, price / rho)
    z = np.clip(np.zeros(len(low)), low, high)
    y = np.zeros(len(low))
    for k in range(0, iterations, ITERATIONS_PER_CLOCK_CHECK):
        if is_late():
            return None
        sweep(min(ITERATIONS_PER_CLOCK_CHECK, iterations - k), splitting, z, y)
    x: FloatArray = splitting.to_x @ (z - y) - splitting.offset
    return x
