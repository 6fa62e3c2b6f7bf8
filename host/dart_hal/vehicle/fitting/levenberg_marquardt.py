"""Levenberg-Marquardt within bounds, for few parameters and residuals that are slow to compute.

Minimises

    cost(x) = sum_i rho(r_i(x)) + prior |x|^2,      rho: soft L1 (``robust.soft_l1``)

With the weights w_i = rho'(r_i) / (2 r_i), W = diag(w) and the Jacobian J = dr/dx, one step d is

    H = J'WJ + prior I,     g = J'Wr + prior x
    d = argmin  d'(H + damping diag(H)) d / 2 + g'd     within the bounds and the largest step

Parameters are in units of their prior standard deviation, so that one damping factor suits all.
A Jacobian costs one rollout for each parameter. It is used again as long as the steps reduce the
cost as it predicts (V. E. Shamanskii, "A modification of Newton's method", 1967).
scipy's ``trf`` needs twice the rollouts for the same joint fit (``benchmarks/bench_solver.py``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.fitting.least_squares import Solution, at_bound
from dart_hal.vehicle.fitting.robust import soft_l1, soft_l1_weight

MAX_ITERATIONS = 40
# Damping is a multiple of the diagonal of H: its first value, the factors after a step that
# reduces the cost and after one that does not, and the value at which the search ends.
FIRST_DAMPING = 1e-3
DAMPING_DECREASE = 0.2
DAMPING_INCREASE = 5.0
MAX_DAMPING = 1e6
COST_TOLERANCE = 1e-4  # relative reduction of the cost below which the fit has converged
EDGES_PER_PARAMETER = 3  # edges of the box that one step may meet, per parameter
MIN_MOVE = 1e-9  # smallest move along a direction, in a parameter's unit
MIN_PREDICTED_SHARE = 0.1  # of the cost tolerance; a step of smaller predicted reduction is skipped
JACOBIAN_TOLERANCE = 0.25  # relative error of the predicted reduction up to which J is used again
# Share of the cost. If no step reduces the cost although the Jacobian predicts more than this, the
# residual is not smooth there and the fit has not converged.
STUCK_PREDICTION = 1e-2


def descend(residual: Callable[[FloatArray], FloatArray],
            jacobian: Callable[[FloatArray, FloatArray], FloatArray], x: FloatArray,
            low: FloatArray, high: FloatArray, *, robust: float | FloatArray, prior: float,
            max_iterations: int = MAX_ITERATIONS, max_step: float | FloatArray = np.inf,
            cost_tolerance: float = COST_TOLERANCE, jacobian_tolerance: float = JACOBIAN_TOLERANCE,
            initial_jacobian: FloatArray | None = None) -> Solution:
    """Minimise the soft L1 loss of residual(x) (n,) plus prior * |x|^2 within bounds.

    1. Linearise, and try the damped step. Raise the damping until a step reduces the cost; with
       an old Jacobian, compute a new one after the first step that does not.
    2. Accept the step and lower the damping. Stop if the reduction is below the tolerance.
    3. Compute a new Jacobian if the reduction differs from the prediction by too much.

    Args:
        residual: x (k,) to residuals (n,).
        jacobian: x, and the residual there, to (n, k).
        x: start (k,); low, high (k,): bounds.
        robust: scale of the soft L1 loss, a number or (n,).
        prior: weight of |x|^2.
        max_step: largest change of a parameter in one step, a number or (k,).
        cost_tolerance: relative reduction of the cost at convergence.
        jacobian_tolerance: see JACOBIAN_TOLERANCE; infinite = one Jacobian for all steps.
        initial_jacobian: a Jacobian from a nearby x for the first step.
    """
    x = np.clip(x, low, high)
    r = residual(x)
    jac = jacobian(x, r) if initial_jacobian is None else initial_jacobian
    one_jacobian = jacobian_tolerance == np.inf
    damping = FIRST_DAMPING
    is_fresh = initial_jacobian is None or one_jacobian  # J belongs to this x
    is_proven = False  # J has led to a step that reduced the cost
    for _ in range(max_iterations):
        weight = soft_l1_weight(r, robust)
        # 1. Quadratic model of the cost at x: Gauss-Newton with the weights of the robust loss.
        weighted = jac * np.sqrt(weight)[:, None]
        hessian = weighted.T @ weighted + prior * np.eye(len(x))
        slope = jac.T @ (weight * r) + prior * x
        cost = _cost(r, x, robust, prior)
        negligible = MIN_PREDICTED_SHARE * cost_tolerance * cost
        has_moved = False
        increase = DAMPING_INCREASE
        # 2. Damped step. The damping rises, each time by a larger factor, until the cost falls.
        while damping < MAX_DAMPING:
            trial = _damped_step(x, hessian, slope, damping, np.maximum(low, x - max_step),
                                 np.minimum(high, x + max_step))
            # reduction of the undamped quadratic: -(2 g'd + d'Hd)
            predicted = -float((2.0 * slope + hessian @ (trial - x)) @ (trial - x))
            if predicted < negligible:
                break
            r_trial = residual(trial)
            reduction = cost - _cost(r_trial, trial, robust, prior)
            if reduction > 0.0:
                x, r = trial, r_trial
                has_moved = True
                damping *= DAMPING_DECREASE
            if has_moved or not is_fresh:
                break
            damping *= increase
            increase *= DAMPING_INCREASE
        # 3. An old Jacobian that leads to no reduction is replaced before the search ends.
        if not has_moved and not is_fresh and not (is_proven and predicted < negligible):
            jac = jacobian(x, r)
            is_fresh = True
            continue
        if not has_moved:
            # At the minimum; or stuck, if the Jacobian predicts a reduction that no step reaches.
            free = _find_free(x, slope, low, high)
            predicted = slope[free] @ np.linalg.solve(hessian[np.ix_(free, free)], slope[free])
            return Solution(x, r, jac, weight, bool(predicted < STUCK_PREDICTION * cost),
                            at_bound(x, low, high))
        if reduction < cost_tolerance * cost and damping < 1.0:
            return Solution(x, r, jac, weight, True, at_bound(x, low, high))
        is_fresh = one_jacobian
        is_proven = True
        if abs(reduction - predicted) > jacobian_tolerance * predicted + cost_tolerance * cost:
            jac = jacobian(x, r)
            is_fresh = True
    return Solution(x, r, jac, weight, False, at_bound(x, low, high))


def _cost(r: FloatArray, x: FloatArray, robust: float | FloatArray, prior: float) -> float:
    return float(np.sum(soft_l1(r, robust)) + prior * (x @ x))


def _damped_step(x: FloatArray, hessian: FloatArray, slope: FloatArray, damping: float,
          low: FloatArray, high: FloatArray) -> FloatArray:
    """Return x after the damped Newton step within the bounds."""
    damped = hessian + damping * np.diag(np.diag(hessian))
    move = solve_box_quadratic(damped, slope, low - x, high - x)
    return np.asarray(np.clip(x + move, low, high))


def _find_free(x: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """Find the parameters (k,) that the gradient does not press against a bound."""
    return np.asarray(~(((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0))))


def solve_box_quadratic(normal: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray
            ) -> FloatArray:
    """Minimise m'Hm / 2 + g'm over moves m (k,) within a box around 0; H: normal, g: slope.

    Active set method. It goes from edge to edge of the box, each time to a lower value:

    1. Free are the parameters that the gradient g + Hm does not press against an edge.
    2. Solve for their Newton direction; remove those that would leave the box at once; repeat.
    3. Go along the direction to the nearest edge, at most to its end. Stop at the minimum.

    Clipping the Newton step instead can raise the value far above that at 0 if parameters are
    nearly collinear.
    """
    move = np.zeros(len(slope))
    for _ in range(EDGES_PER_PARAMETER * len(slope)):
        g = slope + normal @ move
        free = ~(((move <= low) & (g > 0.0)) | ((move >= high) & (g < 0.0)))
        direction = np.zeros(len(slope))
        if free.all():
            end = np.asarray(move - np.linalg.solve(normal, g))
            if ((end >= low) & (end <= high)).all():  # the minimum is inside
                return end
        while free.any():
            direction[~free] = 0.0
            direction[free] = -np.linalg.solve(normal[np.ix_(free, free)], g[free])
            stopped = ((move <= low) & (direction < 0.0)) | ((move >= high) & (direction > 0.0))
            if not stopped.any():
                break
            free &= ~stopped
        edge = np.where(direction > 0.0, high, low)
        with np.errstate(over="ignore"):  # infinite bounds give an infinite share
            share = np.divide(edge - move, direction, out=np.full(len(move), np.inf),
                              where=direction != 0.0)
        nearest = float(share.min(initial=np.inf))
        move = np.clip(move + min(nearest, 1.0) * direction, low, high)
        if nearest < 1.0:
            met = share <= nearest * (1.0 + 1e-12)
            move[met] = edge[met]
        elif free.all() or np.abs(direction).max(initial=0.0) < MIN_MOVE:
            break
    return move
