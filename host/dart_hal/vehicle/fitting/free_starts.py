"""Least squares over many stretches, each with a free start that is eliminated.

Every stretch has one start value of its own, which only its own samples feel:
each step solves for it in closed form, so hundreds of them cost nothing and
the parameters' standard errors contain that the starts are not known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.fitting.levenberg_marquardt import descend
from dart_hal.vehicle.fitting.robust import ROBUST, scatter, soft_l1_weight

Predict = Callable[[FloatArray, FloatArray], FloatArray]
"""(parameters (P, k), starts (P, S)) -> readings (P, n), P variants at once."""
MAX_STEPS = 80
QUIET = 1e-5  # share of the cost; a gain below it is the end: far below any standard error
RIDGE = 1e-12  # prior for what no residual depends on: too weak to move what one does
LEAST = 1e-6  # of the measured unit; a scatter of nought would have no robust loss


@dataclass(frozen=True, slots=True)
class FreeStarts:
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


def shoot(problem: FreeStarts, x0: FloatArray, starts: FloatArray) -> tuple[Solution, FloatArray]:
    """(solution with the starts projected out of its Jacobian, starts (S,)).

    Levenberg-Marquardt within bounds; first plain least squares, then a soft
    L1 loss beyond three times the scatter found.
    """
    p, beyond, x = problem, np.inf, x0
    for _ in range(2):
        along = _Starts(p, starts, beyond)
        found = descend(along.residual, along.jacobian, x, p.low, p.high, robust=beyond,
                        prior=RIDGE, rounds=MAX_STEPS, gain=QUIET)
        x, starts = found.x, along.at(found.x)
        beyond = ROBUST * max(scatter(found.residual), LEAST)
    residual, jac, slope = _linearise(p, x, starts)
    weight = soft_l1_weight(residual, beyond)
    jac, _ = _project(p, residual, jac, slope, weight)
    return Solution(x, residual, jac, weight, found.converged, found.at_bound), starts


class _Starts:
    """What ``descend`` sees of a problem: the starts follow the parameters to first order."""

    def __init__(self, problem: FreeStarts, starts: FloatArray, robust: float) -> None:
        self._problem, self._starts, self._robust = problem, starts, robust
        self._x: FloatArray | None = None

    def at(self, x: FloatArray) -> FloatArray:
        """Starts (S,) by the slopes of the point where the last Jacobian was taken."""
        return self._starts if self._x is None else self._starts + self._back(x - self._x)

    def residual(self, x: FloatArray) -> FloatArray:
        p = self._problem
        return np.asarray(p.predict(x[None], self.at(x)[None])[0] - p.measured)

    def jacobian(self, x: FloatArray, residual: FloatArray) -> FloatArray:
        self._starts = self.at(x)
        self._x = x
        _, jac, slope = _linearise(self._problem, x, self._starts)
        weight = soft_l1_weight(residual, self._robust)
        inner, self._back = _project(self._problem, residual, jac, slope, weight)
        return inner


def _linearise(p: FreeStarts, x: FloatArray, starts: FloatArray
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


def _together(p: FreeStarts, k: int) -> BoolArray:
    """Which parameters (m, k) are moved at once: one by one, those of the groups together."""
    if p.group is None:
        return np.eye(k, dtype=bool)
    shared = k - int(p.group.max()) - 1
    return np.concatenate([np.eye(shared, k, dtype=bool), np.arange(k)[None] >= shared])


def sensitivity(p: FreeStarts, x: FloatArray, starts: FloatArray, weight: FloatArray) -> FloatArray:
    """Jacobian (n, k) without what the starts can take over, at any x (k,)."""
    residual, jac, slope = _linearise(p, x, starts)
    return _project(p, residual, jac, slope, weight)[0]


def _project(p: FreeStarts, residual: FloatArray, jac: FloatArray, slope: FloatArray,
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
