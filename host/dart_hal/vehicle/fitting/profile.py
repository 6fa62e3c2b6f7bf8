"""Is a standard error that of the loss? The loss at two standard errors to both sides tells.

A standard error stands on slopes at one point. Where the residuals are rough, or the loss is no
parabola over the width of the error, it says nothing. So each parameter is moved by two of its
standard errors, the others follow to where the loss is least, and the change of the loss is
compared with that of the quadratic.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.fitting.covariance import scaled_inverse
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.fitting.robust import soft_l1, soft_l1_weight

REACH = 2.0
"""Standard errors to each side at which the loss is compared."""
AGREES = 0.3
"""Share of the quadratic's change by which the loss may differ from it."""
MOVES = 0.2
"""Share of the step that must be left within the bounds; a side with less is not asked."""
FOLLOWS = 6
"""Steps in which the others follow: in a curved valley the straight line leads up its side."""
FLAT = 1e-9
"""Change of the quadratic, in squared residuals, below which there is nothing to compare."""


def quadratic_sides(residual: Callable[[FloatArray], FloatArray], solution: Solution,
                    std: FloatArray, low: FloatArray, high: FloatArray, *,
                    robust: float | FloatArray = np.inf, prior: float = 0.0) -> BoolArray:
    """Decide for each parameter (k,) whether the loss agrees with its quadratic on both sides.

    1. Move parameter i by +-2 std_i, the others along the profile of the quadratic:
       d = (H^-1)_i / (H^-1)_ii * (+-2 std_i), clipped to the bounds.
    2. The quadratic changes by 2 g d + d H d, the loss by what ``residual`` says there.
    3. They agree where they differ by at most 30 % of d H d. Where the loss is larger, the other
       parameters take Gauss-Newton steps with the same Jacobian, and the least loss counts.
    4. A side that a bound cuts off is not asked; where both are, the parameter does not agree.

    residual(x) (n,): as it was fitted; solution: of it, its Jacobian two-sided; std (k,): the
    standard errors that are to be stated, not finite = never agrees; robust, prior: of the loss,
    as ``descend`` has them.
    """
    x, jacobian = solution.x, solution.jacobian
    weighted = jacobian * solution.weight[:, None]
    hessian = weighted.T @ jacobian + prior * np.eye(len(x))
    # soft L1 has the slope w r and the curvature w^3 of its weight w
    bend = (jacobian * solution.weight[:, None]**3).T @ jacobian + prior * np.eye(len(x))
    slope = weighted.T @ solution.residual + prior * x
    inverse = scaled_inverse(hessian)

    def loss(at: FloatArray, r: FloatArray) -> float:
        return float(np.sum(soft_l1(r, robust)) + prior * (at @ at))

    def profile(at: FloatArray, i: int, enough: float) -> float:
        """The loss with parameter i held at ``at``, followed until it is ``enough``."""
        others = np.arange(len(at)) != i
        solve = scaled_inverse(hessian[np.ix_(others, others)])
        least = np.inf
        for _ in range(FOLLOWS):
            r = residual(at)
            found = loss(at, r)
            if found >= least:
                break
            least = found
            if least <= enough:
                break
            down = jacobian.T @ (soft_l1_weight(r, robust) * r) + prior * at
            at = at.copy()
            at[others] -= solve @ down[others]
            at = np.clip(at, low, high)
        return least

    here = loss(x, solution.residual)
    agrees = np.zeros(len(x), dtype=bool)
    for i, width in enumerate(std):
        if not (np.isfinite(width) and width > 0.0 and inverse[i, i] > 0.0):
            continue
        direction = inverse[i] / inverse[i, i] * REACH * width
        asked = []
        for side in (1.0, -1.0):
            move = np.clip(x + side * direction, low, high) - x
            curved = float(move @ bend @ move)
            if abs(move[i]) < MOVES * REACH * width or curved < FLAT:
                continue
            predicted = 2.0 * float(slope @ move) + curved
            most = predicted + AGREES * curved
            found = profile(x + move, i, here + most) - here
            asked.append(abs(found - predicted) <= AGREES * curved)
        agrees[i] = bool(asked) and all(asked)
    return agrees
