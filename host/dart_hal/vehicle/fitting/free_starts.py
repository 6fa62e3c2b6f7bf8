"""Least squares over many stretches of a recording, each with an unknown start value.

The residual of stretch j depends on the parameters x and on one start value s_j of its own:

    r_i = J_i x + b_i s_j,     i in stretch j

For given x the best start is in closed form (variable projection, Golub and Pereyra 1973):

    s_j = -sum_j(w_i b_i r_i) / sum_j(w_i b_i^2)

so the starts are eliminated from each step. Hundreds of them cost no rollouts, and the standard
errors of the parameters include that the starts are unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.fitting.levenberg_marquardt import descend
from dart_hal.vehicle.fitting.robust import SOFT_L1_STDS, scatter, soft_l1_weight

# (parameters (P, k), starts (P, S)) -> readings (P, n), for P variants in one call.
Predict = Callable[[FloatArray, FloatArray], FloatArray]
MAX_STEPS = 80
# Share of the cost; a smaller reduction in one step ends the fit. The parameters then move by far
# less than their standard errors.
START_COST_TOLERANCE = 1e-5
RIDGE_PRIOR = 1e-12  # prior weight of parameters that no residual depends on; too weak for others
MIN_SCATTER = 1e-6  # in the measured unit; the robust loss needs a scale above zero


@dataclass(frozen=True, slots=True)
class FreeStarts:
    """A problem: predict, measured (n,), stretch (n,) 0..S-1; bounds and difference steps (k,).

    group (n,) 0..G-1: each of the last G parameters changes the samples of one group only, so
    one pair of rollouts gives all their differences. None: all parameters are shared.
    """

    predict: Predict
    measured: FloatArray
    stretch: IntArray
    low: FloatArray
    high: FloatArray
    step: FloatArray
    group: IntArray | None = None


def fit_free_starts(problem: FreeStarts, x0: FloatArray, starts: FloatArray
                    ) -> tuple[Solution, FloatArray]:
    """Fit parameters and starts; return the solution and the starts (S,).

    1. Plain least squares by Levenberg-Marquardt within bounds.
    2. The same with a soft L1 loss, its scale three times the scatter of the residuals of step 1.

    The starts are projected out of the Jacobian of the solution.
    """
    p = problem
    x = x0
    scale = np.inf
    for _ in range(2):
        model = _Starts(p, starts, scale)
        found = descend(model.residual, model.jacobian, x, p.low, p.high, robust=scale,
                        prior=RIDGE_PRIOR, max_iterations=MAX_STEPS,
                        cost_tolerance=START_COST_TOLERANCE)
        x = found.x
        starts = model.predict_starts(x)
        scale = SOFT_L1_STDS * max(scatter(found.residual), MIN_SCATTER)
    residual, jac, slope = _linearise(p, x, starts)
    weight = soft_l1_weight(residual, scale)
    jac, _ = _project(p, residual, jac, slope, weight)
    return Solution(x, residual, jac, weight, found.converged, found.at_bound), starts


class _Starts:
    """Residual and Jacobian in the parameters alone; the starts follow them to first order."""

    def __init__(self, problem: FreeStarts, starts: FloatArray, robust: float) -> None:
        self._problem = problem
        self._starts = starts
        self._robust = robust
        self._x: FloatArray | None = None

    def predict_starts(self, x: FloatArray) -> FloatArray:
        """Return the starts (S,) at x, linearised at the point of the last Jacobian."""
        return self._starts if self._x is None else self._starts + self._move_starts(x - self._x)

    def residual(self, x: FloatArray) -> FloatArray:
        p = self._problem
        return np.asarray(p.predict(x[None], self.predict_starts(x)[None])[0] - p.measured)

    def jacobian(self, x: FloatArray, residual: FloatArray) -> FloatArray:
        self._starts = self.predict_starts(x)
        self._x = x
        _, jac, slope = _linearise(self._problem, x, self._starts)
        weight = soft_l1_weight(residual, self._robust)
        inner, self._move_starts = _project(self._problem, residual, jac, slope, weight)
        return inner


def _linearise(p: FreeStarts, x: FloatArray, starts: FloatArray
               ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute residual (n,), d/dx (n, k) and d/dstart (n,) from one batch of variants.

    Rows of the batch: x; x with all starts 1e-5 higher; each difference direction up; each down.
    """
    # Central differences, divided by the real distance: at a bound they are one-sided.
    up = np.minimum(x + p.step, p.high)
    down = np.maximum(x - p.step, p.low)
    move = _difference_directions(p, len(x))
    variants = np.concatenate([np.tile(x, (2, 1)), np.where(move, up, x), np.where(move, down, x)])
    tiled = np.tile(starts, (len(variants), 1))
    tiled[1] += 1e-5
    read = p.predict(variants, tiled)
    change = read[2:2 + len(move)] - read[2 + len(move):]
    # The last pair of rollouts moved all grouped parameters: each one's share is in the samples of
    # its group.
    if p.group is not None:
        shared = len(move) - 1
        own = np.where(p.group == np.arange(len(x) - shared)[:, None], change[-1], 0.0)
        change = np.concatenate([change[:-1], own])
    return read[0] - p.measured, (change / (up - down)[:, None]).T, (read[1] - read[0]) / 1e-5


def _difference_directions(p: FreeStarts, k: int) -> BoolArray:
    """Return which parameters (m, k) move together: shared ones singly, grouped ones at once."""
    if p.group is None:
        return np.eye(k, dtype=bool)
    shared = k - int(p.group.max()) - 1
    return np.concatenate([np.eye(shared, k, dtype=bool), np.arange(k)[None] >= shared])


def sensitivity(p: FreeStarts, x: FloatArray, starts: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the Jacobian (n, k) at any x (k,), the starts projected out."""
    residual, jac, slope = _linearise(p, x, starts)
    return _project(p, residual, jac, slope, weight)[0]


def _project(p: FreeStarts, residual: FloatArray, jac: FloatArray, slope: FloatArray,
             weight: FloatArray) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
    """Project the starts out; return the Jacobian (n, k) and d(x) (k,) -> d(starts) (S,).

    With sums over the samples of a stretch, a = sum(w b J) / sum(w b^2):

        J_projected = J - b a,     d(starts) = -sum(w b r) / sum(w b^2) - a d(x)
    """
    count = int(p.stretch.max()) + 1

    def sum_by_stretch(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(p.stretch, values, minlength=count), dtype=np.float64)

    # The start of a stretch solves one equation, sum(w b^2) s = -sum(w b (r + J dx)).
    square = np.maximum(sum_by_stretch(weight * slope**2), 1e-12)
    share = np.stack([sum_by_stretch(weight * slope * column) for column in jac.T], axis=1)
    share = share / square[:, None]
    rest = sum_by_stretch(weight * slope * residual) / square
    inner = jac - slope[:, None] * share[p.stretch]

    def move_starts(move: FloatArray) -> FloatArray:
        return np.asarray(-rest - share @ move)

    return inner, move_starts
