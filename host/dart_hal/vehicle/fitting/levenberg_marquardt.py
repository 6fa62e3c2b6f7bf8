"""Levenberg-Marquardt within bounds for few parameters and dear residuals.

A general solver spends most of its rollouts at the bounds where delays and
lags like to end, and scales its steps without knowing the priors. Parameters
here are in units of their prior, so that damping and prior are the same thing.
A Jacobian costs a rollout for every parameter: it is kept as long as steps gain
what it promises (Shamanskii 1967).
scipy's ``trf`` needs twice the rollouts for the same joint fit
(``benchmarks/bench_solver.py``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.fitting.least_squares import Solution, at_bound
from dart_hal.vehicle.fitting.robust import soft_l1, soft_l1_weight

ROUNDS = 40
DAMPING, EASIER, HARDER, TOO_HARD = 1e-3, 0.2, 5.0, 1e6  # of the diagonal: first, factors, end
CONVERGED = 1e-4  # of the cost
EDGES = 3  # times the number of parameters: edges of the box that a step may meet
SMALL = 1e-9  # of a parameter's unit
NOTHING = 0.1  # of the gain at which a fit has converged; a step that promises less is not tried
KEPT = 0.25  # of what a Jacobian promises; one whose step gains it within as much is kept
STUCK = 1e-2  # of the cost; a larger gain was promised where no step gained anything


def descend(residual: Callable[[FloatArray], FloatArray],
            jacobian: Callable[[FloatArray, FloatArray], FloatArray], x: FloatArray,
            low: FloatArray, high: FloatArray, *, robust: float | FloatArray, prior: float,
            rounds: int = ROUNDS, reach: float | FloatArray = np.inf,
            gain: float = CONVERGED, kept: float = KEPT, first: FloatArray | None = None
            ) -> Solution:
    """Minimise the soft L1 of residual(x) beyond ``robust`` (a number or (n,)), plus prior * |x|^2.

    jacobian(x, r) (n, k) at x, where the residual is r. reach: how far a slope is
    believed, a number or (k,); no step goes further. gain: share of the cost below
    which the fit has converged. kept: see KEPT; infinite = one Jacobian for all.
    first: a Jacobian to begin with, from nearby.
    """
    x = np.clip(x, low, high)
    r = residual(x)
    jac = jacobian(x, r) if first is None else first
    damping, fresh, proved = DAMPING, first is None or kept == np.inf, False
    for _ in range(rounds):
        weight = soft_l1_weight(r, robust)
        weighted = jac * np.sqrt(weight)[:, None]
        hessian = weighted.T @ weighted + prior * np.eye(len(x))
        slope = jac.T @ (weight * r) + prior * x
        cost, moved, harder = _cost(r, x, robust, prior), False, HARDER
        while damping < TOO_HARD:
            trial = _step(x, hessian, slope, damping, np.maximum(low, x - reach),
                          np.minimum(high, x + reach))
            promised = -float((2.0 * slope + hessian @ (trial - x)) @ (trial - x))
            if promised < NOTHING * gain * cost:
                break
            r_trial = residual(trial)
            gained = cost - _cost(r_trial, trial, robust, prior)
            if gained > 0.0:
                x, r, moved = trial, r_trial, True
                damping *= EASIER
            if moved or not fresh:
                break
            damping, harder = damping * harder, harder * HARDER
        if not moved and not fresh and not (proved and promised < NOTHING * gain * cost):
            jac, fresh = jacobian(x, r), True
            continue
        if not moved:
            # at the bottom, or stuck where the Jacobian promises what no step keeps
            free = _free(x, slope, low, high)
            promised = slope[free] @ np.linalg.solve(hessian[np.ix_(free, free)], slope[free])
            return Solution(x, r, jac, weight, bool(promised < STUCK * cost),
                            at_bound(x, low, high))
        if gained < gain * cost and damping < 1.0:
            return Solution(x, r, jac, weight, True, at_bound(x, low, high))
        fresh, proved = kept == np.inf, True
        if abs(gained - promised) > kept * promised + gain * cost:
            jac, fresh = jacobian(x, r), True
    return Solution(x, r, jac, weight, False, at_bound(x, low, high))


def _cost(r: FloatArray, x: FloatArray, robust: float | FloatArray, prior: float) -> float:
    return float(np.sum(soft_l1(r, robust)) + prior * (x @ x))


def _step(x: FloatArray, hessian: FloatArray, slope: FloatArray, damping: float,
          low: FloatArray, high: FloatArray) -> FloatArray:
    """The damped Newton step within the bounds."""
    damped = hessian + damping * np.diag(np.diag(hessian))
    move = bounded(damped, slope, low - x, high - x)
    return np.asarray(np.clip(x + move, low, high))


def _free(x: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """Parameters that are not held at a bound by the slope."""
    return np.asarray(~(((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0))))


def bounded(normal: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray
            ) -> FloatArray:
    """The move (k,) within a box around 0 that lowers m normal m / 2 + slope m most.

    From edge to edge, and lower with each: where parameters nearly do the same,
    to hold whatever leaves the box at its edge may end far above the beginning.
    """
    move = np.zeros(len(slope))
    for _ in range(EDGES * len(slope)):
        g = slope + normal @ move
        free = ~(((move <= low) & (g > 0.0)) | ((move >= high) & (g < 0.0)))
        direction = np.zeros(len(slope))
        while free.any():
            direction[~free] = 0.0
            direction[free] = -np.linalg.solve(normal[np.ix_(free, free)], g[free])
            stopped = ((move <= low) & (direction < 0.0)) | ((move >= high) & (direction > 0.0))
            if not stopped.any():
                break
            free &= ~stopped
        edge = np.where(direction > 0.0, high, low)
        with np.errstate(over="ignore"):  # an edge that is infinitely far is none
            share = np.divide(edge - move, direction, out=np.full(len(move), np.inf),
                              where=direction != 0.0)
        nearest = float(share.min(initial=np.inf))
        move = np.clip(move + min(nearest, 1.0) * direction, low, high)
        if nearest < 1.0:
            met = share <= nearest * (1.0 + 1e-12)
            move[met] = edge[met]
        elif free.all() or np.abs(direction).max(initial=0.0) < SMALL:
            break
    return move
