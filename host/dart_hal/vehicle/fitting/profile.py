"""Check a standard error against the loss, two standard errors to each side.

A standard error is computed from slopes at one point. It is wrong if the residuals are rough, or
if the loss is no parabola over the width of the error. So each parameter is moved by two of its
standard errors, the other parameters follow to the smallest loss (profile likelihood), and the
change of the loss is compared with that of the quadratic.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.fitting.covariance import scaled_inverse
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.fitting.robust import soft_l1, soft_l1_weight

PROFILE_STDS = 2.0  # standard errors to each side at which the loss is compared
LOSS_TOLERANCE = 0.3  # share of the quadratic's change by which the loss may differ from it
MIN_STEP_SHARE = 0.2  # share of the step within the bounds; a side with less is not compared
# Steps in which the other parameters follow. They are needed where the valley of the loss is
# curved: the straight line of the quadratic then leaves its bottom.
MAX_PROFILE_STEPS = 6
MIN_CURVATURE = 1e-9  # squared residuals; a smaller change of the quadratic is not compared


def agrees_with_quadratic(residual: Callable[[FloatArray], FloatArray], solution: Solution,
                    std: FloatArray, low: FloatArray, high: FloatArray, *,
                    robust: float | FloatArray = np.inf, prior: float = 0.0) -> BoolArray:
    """Decide for each parameter (k,) whether the loss agrees with its quadratic on both sides.

    1. Move parameter i by +-2 std_i, the others along the profile of the quadratic:
       d = (H^-1)_i / (H^-1)_ii * (+-2 std_i), clipped to the bounds.
    2. The quadratic changes by 2 g d + d H d. Compute the change of the loss from ``residual``.
    3. They agree if they differ by at most 30 % of d H d. If the loss is larger, the other
       parameters take Gauss-Newton steps with the same Jacobian, and the smallest loss counts.
    4. A side that a bound cuts off is not compared. Without either side, the result is False.

    residual(x) (n,): the fitted function; solution: its fit, with a two-sided Jacobian; std (k,):
    standard errors to check, False where not finite; robust, prior: as in ``descend``.
    """
    x = solution.x
    jacobian = solution.jacobian
    weighted = jacobian * solution.weight[:, None]
    hessian = weighted.T @ jacobian + prior * np.eye(len(x))
    # Half the soft L1 loss has the first derivative w r and the second w^3, w its weight.
    bend = (jacobian * solution.weight[:, None]**3).T @ jacobian + prior * np.eye(len(x))
    slope = weighted.T @ solution.residual + prior * x
    inverse = scaled_inverse(hessian)

    def loss(point: FloatArray, r: FloatArray) -> float:
        return float(np.sum(soft_l1(r, robust)) + prior * (point @ point))

    def profile(point: FloatArray, i: int, enough: float) -> float:
        """Minimise the loss over all parameters but i, until it is at most ``enough``."""
        others = np.arange(len(point)) != i
        solve = scaled_inverse(hessian[np.ix_(others, others)])
        least = np.inf
        for _ in range(MAX_PROFILE_STEPS):
            r = residual(point)
            found = loss(point, r)
            if found >= least:
                break
            least = found
            if least <= enough:
                break
            gradient = jacobian.T @ (soft_l1_weight(r, robust) * r) + prior * point
            point = point.copy()
            point[others] -= solve @ gradient[others]
            point = np.clip(point, low, high)
        return least

    here = loss(x, solution.residual)
    agrees = np.zeros(len(x), dtype=bool)
    for i, width in enumerate(std):
        if not (np.isfinite(width) and width > 0.0 and inverse[i, i] > 0.0):
            continue
        direction = inverse[i] / inverse[i, i] * PROFILE_STDS * width
        compared = []
        for side in (1.0, -1.0):
            move = np.clip(x + side * direction, low, high) - x
            curved = float(move @ bend @ move)
            if abs(move[i]) < MIN_STEP_SHARE * PROFILE_STDS * width or curved < MIN_CURVATURE:
                continue
            predicted = 2.0 * float(slope @ move) + curved
            most = predicted + LOSS_TOLERANCE * curved
            found = profile(x + move, i, here + most) - here
            compared.append(abs(found - predicted) <= LOSS_TOLERANCE * curved)
        agrees[i] = bool(compared) and all(compared)
    return agrees
