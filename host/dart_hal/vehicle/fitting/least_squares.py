"""Nonlinear least squares within bounds, optionally with a robust loss."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.fitting.robust import soft_l1_weight

# Share of the interval [low, high]; a parameter closer to an end is at its bound.
BOUND_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Solution:
    """Result of a fit: x (k,), residual (n,) and Jacobian (n, k) there, without robust weights.

    weight (n,): 1 for least squares, less for outliers under a robust loss.
    """

    x: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    weight: FloatArray
    converged: bool
    at_bound: BoolArray

    @property
    def rmse(self) -> float:
        """Root mean square of the plain residuals."""
        return float(np.sqrt(np.mean(self.residual**2)))


def least_squares(residual: Callable[[FloatArray], FloatArray], x0: Sequence[float],
                  bounds: tuple[Sequence[float], Sequence[float]], *,
                  jacobian: Callable[[FloatArray], FloatArray] | None = None,
                  robust: float | None = None, tolerance: float = 1e-12) -> Solution:
    """Minimise the sum of squares of residual(x) (n,) within bounds.

    jacobian(x) (n, k), None = three-point differences; robust: scale of a soft L1 loss in the unit
    of the residual, None = plain squares.
    """
    from scipy.optimize import least_squares as scipy_least_squares

    low, high = (np.asarray(b, dtype=np.float64) for b in bounds)
    result = scipy_least_squares(
        residual, np.clip(x0, low, high), jac=jacobian or "3-point", bounds=(low, high),
        x_scale="jac", loss="linear" if robust is None else "soft_l1", f_scale=robust or 1.0,
        xtol=tolerance, ftol=tolerance, gtol=tolerance)
    r = np.asarray(residual(result.x), dtype=np.float64)
    jac = np.asarray(jacobian(result.x) if jacobian
                     else _differences(residual, result.x, low, high))
    weight = np.ones(len(r)) if robust is None else soft_l1_weight(r, robust)
    return Solution(np.asarray(result.x), r, jac, weight, bool(result.status > 0),
                    at_bound(result.x, low, high))


def fit_curve(curve: Callable[[FloatArray], tuple[FloatArray, FloatArray]], target: FloatArray,
              x0: Sequence[float], bounds: tuple[Sequence[float], Sequence[float]], *,
              robust: float | None = None, tolerance: float = 1e-12) -> Solution:
    """Fit curve(x) -> (values (n,), slopes (n, k)) to target (n,); see ``least_squares``."""
    known: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def evaluate(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = x.tobytes()
        if key not in known:  # the solver calls residual, then jacobian, at the same x
            known.clear()
            known[key] = curve(x)
        return known[key]

    return least_squares(lambda x: evaluate(x)[0] - target, x0, bounds,
                         jacobian=lambda x: evaluate(x)[1], robust=robust, tolerance=tolerance)


def at_bound(x: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """Return which parameters (k,) are at an end of their interval."""
    span = high - low
    near = BOUND_TOLERANCE * np.where(np.isfinite(span), span, 1.0)
    return np.asarray((x - low < near) | (high - x < near))


def _differences(residual: Callable[[FloatArray], FloatArray], x: FloatArray, low: FloatArray,
                 high: FloatArray) -> FloatArray:
    """Compute central differences (n, k); one-sided at a bound."""
    columns = []
    for i, value in enumerate(x):
        # A millionth of the value; near 0, of a thousandth of its interval.
        step = 1e-6 * max(abs(float(value)), 1e-3 * float(high[i] - low[i]))
        up = x.copy()
        down = x.copy()
        up[i] = min(value + step, high[i])
        down[i] = max(value - step, low[i])
        columns.append((residual(up) - residual(down)) / (up[i] - down[i]))
    return np.stack(columns, axis=1)
