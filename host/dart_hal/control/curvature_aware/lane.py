"""The lane, a disc of its half width around the path's point of each stage, and obstacles in it.

    ((W + slack) / 2)^2 - |p - p_r|^2 >= 0      100 slack^2 in the cost

which is a row of the distance: |p - p_r| <= (W + slack) / 2. If p_r is not the closest point to p,
because its progress is wrong, the disc is at another position of the lane. Obstacles bound the
lateral error, as in ``mpc.obstacles``.
"""

from __future__ import annotations

from math import inf

import numpy as np

from dart_hal.control.curvature_aware.programme import LeastSquaresProgramme
from dart_hal.control.mpc.problem import RHO_METRE, Weights
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.namespace import Value

# Weight of the squared slack, and largest slack [m].
SLACK_COST = 100.0
MAX_SLACK = 100.0
# Price per metre of violation of an obstacle bound: that of ``mpc``.
OBSTACLE_PRICE = Weights().lane
# Smooths the distance around 0 [m], where it is not differentiable.
DISTANCE_SMOOTHING = 1e-4

# Lower and upper bound [m] of the lateral error at each stage.
Bounds = tuple[FloatArray, FloatArray]


def lane_distances(x: Value, y: Value, x_r: Value, y_r: Value, phi: Value) -> tuple[Value, Value]:
    """Return (distance, lateral error, left positive) [m] of a point relative to one of the path.
    """
    dx = x - x_r
    dy = y - y_r
    return (np.sqrt(dx * dx + dy * dy + DISTANCE_SMOOTHING**2),
            np.cos(phi) * dy - np.sin(phi) * dx)


def add_lane_rows(
    programme: LeastSquaresProgramme,
    values: FloatArray,
    slopes: FloatArray,
    half: float,
    bounds: Bounds | None,
) -> None:
    """Add the rows of (distance, lateral error): values (n, 2), slopes (n, 2, size)."""
    n = programme.n
    slack = np.hstack([np.zeros((n, programme.size - n)), np.eye(n)])
    programme.add_squares(np.zeros(n), slack, SLACK_COST)
    programme.add_bounds(np.zeros(n), slack, 0.0, MAX_SLACK, RHO_METRE)
    programme.add_bounds(values[:, 0], slopes[:, 0] - 0.5 * slack, -inf, half, RHO_METRE)
    if bounds is not None:
        programme.add_bounds(values[:, 1], slopes[:, 1], *bounds, RHO_METRE, OBSTACLE_PRICE)
