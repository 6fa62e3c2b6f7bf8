"""Least squares over many stretches, each with a free start that is eliminated.

Every stretch has one start value of its own, which only its own samples feel:
each step solves for it in closed form, so hundreds of them cost nothing and
the parameters' standard errors contain that the starts are not known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dart_hal.fitting.least_squares import EDGE, Solution
from dart_hal.fitting.robust import scatter, soft_l1, soft_l1_weight
from dart_hal.types import BoolArray, FloatArray, IntArray

Predict = Callable[[FloatArray, FloatArray], FloatArray]
"""(parameters (P, k), starts (P, S)) -> readings (P, n), P variants at once."""
MAX_STEPS = 80
QUIET = 1e-5  # share of the cost; twice a gain below it is the end: far below any standard error
ROBUST = 3.0  # times the robust scatter: beyond it the loss grows linearly


@dataclass(frozen=True, slots=True)
class Problem:
    """predict, measured (n,), stretch (n,) 0..S-1; bounds and difference steps (k,).

    group (n,) 0..G-1: the last G parameters are each felt by one group of
    samples alone, and are therefore differenced all at once. None: all shared.
    """

    predict: Predict
    measured: FloatArray
    stretch: IntArray
    low: FloatArray
    high: FloatArray
    step: FloatArray
    group: IntArray | None = None


def shoot(problem: Problem, x0: FloatArray, starts: FloatArray) -> tuple[Solution, FloatArray]:
    """(solution with the starts projected out of its Jacobian, starts (S,)).

    Levenberg-Marquardt within bounds; first plain least squares, then a soft
    L1 loss beyond three times the scatter found.
    """
    x = np.clip(x0, problem.low, problem.high)
    x, starts, _, scale = _descend(problem, x, starts, np.inf)
    x, starts, converged, _ = _descend(problem, x, starts, ROBUST * scale)
    residual, jac, slope = _linearise(problem, x, starts)
    weight = soft_l1_weight(residual, ROBUST * scale)
    jac, _ = _project(problem, residual, jac, slope, weight)
    span = problem.high - problem.low
    edge = (x - problem.low < EDGE * span) | (problem.high - x < EDGE * span)
    return Solution(x, residual, jac, weight, converged, np.asarray(edge)), starts


def _cost(residual: FloatArray, robust: float) -> float:
    if np.isinf(robust):
        return float(residual @ residual)
    return float(np.sum(soft_l1(residual, robust)))


def _descend(p: Problem, x: FloatArray, starts: FloatArray, robust: float
             ) -> tuple[FloatArray, FloatArray, bool, float]:
    damping, converged, quiet = 1e-4, False, 0
    residual, jac, slope = _linearise(p, x, starts)
    cost = _cost(residual, robust)
    for _ in range(MAX_STEPS):
        weight = soft_l1_weight(residual, robust)
        inner, back = _project(p, residual, jac, slope, weight)
        gradient = inner.T @ (weight * residual)
        hessian = inner.T @ (weight[:, None] * inner)
        free = ~(((x <= p.low) & (gradient > 0.0)) | ((x >= p.high) & (gradient < 0.0)))
        move = np.zeros_like(x)
        left = hessian[np.ix_(free, free)]
        scaled = left + damping * np.diag(np.diag(left) + 1e-12 * np.trace(left))
        move[free] = -np.linalg.lstsq(scaled, gradient[free], rcond=None)[0]
        new_x = np.clip(x + move, p.low, p.high)
        new_starts = starts + back(new_x - x)
        trial = p.predict(new_x[None], new_starts[None])[0] - p.measured
        new_cost = _cost(trial, robust)
        if not new_cost <= cost:
            damping *= 10.0
            if damping > 1e8:
                converged = True
                break
            continue
        gain = (cost - new_cost) / max(cost, 1e-300)
        x, starts, cost, damping = new_x, new_starts, new_cost, max(damping / 10.0, 1e-9)
        quiet = quiet + 1 if gain < QUIET else 0
        residual, jac, slope = _linearise(p, x, starts)
        if quiet == 2:
            converged = True
            break
    return x, starts, converged, _scatter(residual)


def _scatter(residual: FloatArray) -> float:
    """Standard deviation by the median of sizes; never zero."""
    return max(scatter(residual), 1e-6)


def _linearise(p: Problem, x: FloatArray, starts: FloatArray
               ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """residual (n,), d/dx (n, k), d/dstart (n,) out of one batch of variants."""
    up = np.minimum(x + p.step, p.high)
    down = np.maximum(x - p.step, p.low)
    move = _together(p, len(x))
    variants = np.concatenate([np.tile(x, (2, 1)), np.where(move, up, x), np.where(move, down, x)])
    held = np.tile(starts, (len(variants), 1))
    held[1] += 1e-5
    read = p.predict(variants, held)
    change = read[2:2 + len(move)] - read[2 + len(move):]
    if p.group is not None:
        shared = len(move) - 1
        own = np.where(p.group == np.arange(len(x) - shared)[:, None], change[-1], 0.0)
        change = np.concatenate([change[:-1], own])
    return read[0] - p.measured, (change / (up - down)[:, None]).T, (read[1] - read[0]) / 1e-5


def _together(p: Problem, k: int) -> BoolArray:
    """Which parameters (m, k) are moved at once: one by one, those of the groups together."""
    if p.group is None:
        return np.eye(k, dtype=bool)
    shared = k - int(p.group.max()) - 1
    return np.concatenate([np.eye(shared, k, dtype=bool), np.arange(k)[None] >= shared])


def sensitivity(p: Problem, x: FloatArray, starts: FloatArray, weight: FloatArray) -> FloatArray:
    """Jacobian (n, k) without what the starts can take over, at any x (k,)."""
    residual, jac, slope = _linearise(p, x, starts)
    return _project(p, residual, jac, slope, weight)[0]


def _project(p: Problem, residual: FloatArray, jac: FloatArray, slope: FloatArray,
             weight: FloatArray) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
    """(Jacobian without what the starts can take over, move of x -> move of the starts)."""
    count = int(p.stretch.max()) + 1

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(p.stretch, values, minlength=count), dtype=np.float64)

    square = np.maximum(summed(weight * slope**2), 1e-12)
    share = np.stack([summed(weight * slope * column) for column in jac.T], axis=1)
    share = share / square[:, None]
    rest = summed(weight * slope * residual) / square
    inner = jac - slope[:, None] * share[p.stretch]

    def back(move: FloatArray) -> FloatArray:
        return np.asarray(-rest - share @ move)

    return inner, back
