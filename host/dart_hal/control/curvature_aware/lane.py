"""The lane, a disc of its half width about the path's point of each stage, and what stands in it.

    ((W + slack) / 2)^2 - |p - p_r|^2 >= 0      100 slack^2 in the cost

which is a row of the distance: |p - p_r| <= (W + slack) / 2. Where the point p_r is not beside p,
because its progress is wrong, the disc lies at another place of the lane. Obstacles bound the error
across, as in ``mpc.obstacles``.
"""

from __future__ import annotations

from math import inf

import numpy as np

from dart_hal.control.curvature_aware.programme import Programme
from dart_hal.control.mpc.problem import RHO_METRE, Weights
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.namespace import Value

# Price of its square, and the most [m].
SLACK = 100.0
MOST_SLACK = 100.0
# Price of a metre into an obstacle: that of ``mpc``.
OBSTACLE = Weights().lane
# m; smooths the distance about 0, where it has no slope.
NOWHERE = 1e-4

# Least and most [m] of the error across at each stage.
Bounds = tuple[FloatArray, FloatArray]


def beside(x: Value, y: Value, x_r: Value, y_r: Value, phi: Value) -> tuple[Value, Value]:
    """(distance, distance across, left positive) [m] of a point to one of the path."""
    dx = x - x_r
    dy = y - y_r
    return (np.sqrt(dx * dx + dy * dy + NOWHERE**2),
            np.cos(phi) * dy - np.sin(phi) * dx)


def keep(programme: Programme, at: FloatArray, by: FloatArray, half: float,
         bounds: Bounds | None) -> None:
    """Rows of (distance, across): at (n, 2), by (n, 2, size)."""
    n = programme.n
    slack = np.hstack([np.zeros((n, programme.size - n)), np.eye(n)])
    programme.squares(np.zeros(n), slack, SLACK)
    programme.bound(np.zeros(n), slack, 0.0, MOST_SLACK, RHO_METRE)
    programme.bound(at[:, 0], by[:, 0] - 0.5 * slack, -inf, half, RHO_METRE)
    if bounds is not None:
        programme.bound(at[:, 1], by[:, 1], *bounds, RHO_METRE, OBSTACLE)
