"""Least squares over repeated steps, with standard errors from how the repetitions differ.

What a model leaves of one step is one error, not a hundred: samples of one repetition hang
together. The covariance is therefore the sandwich over repetitions (clusters),

    cov = H^-1 (sum_k g_k g_k') H^-1  K / (K - 1),   g_k = J_k' r_k,  H = J'J (+ prior)

K. Liang and S. Zeger, "Longitudinal data analysis using generalized linear models" (1986).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dart_hal.types import FloatArray, IntArray

Residual = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Fit:
    """Parameters (n,), covariance (n, n), rms of what is left, and of the data themselves."""

    x: FloatArray
    covariance: FloatArray
    left: float

    @property
    def std(self) -> FloatArray:
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_clusters(residual: Residual, start: FloatArray, low: FloatArray, high: FloatArray,
                 cluster: IntArray | None, steps: FloatArray, priors: int = 0,
                 noise: float = 1.0) -> Fit:
    """residual(x) -> (m,), of which row i belongs to repetition cluster[i] (None: rows are
    independent); the last ``priors``
    rows, which have no cluster, are what was known before, in standard errors times ``noise``."""
    from scipy.optimize import least_squares

    found = least_squares(residual, start, bounds=(low, high), diff_step=1e-4, x_scale=steps)
    x, r = found.x, found.fun
    rows = len(r) - priors
    scale = float(np.sqrt(np.mean(r[:rows] ** 2)))
    jac = np.column_stack([_slope(residual, x, k, steps[k]) for k in range(len(x))])
    data, prior = jac[:rows], jac[rows:] / noise
    hessian = data.T @ data / scale**2 + prior.T @ prior
    inverse = np.linalg.pinv(hessian)
    if cluster is None:
        return Fit(np.asarray(x), inverse, scale)
    names = np.unique(cluster)
    scores = np.array([data[cluster == k].T @ r[:rows][cluster == k] for k in names]) / scale**2
    meat = scores.T @ scores * len(names) / (len(names) - 1.0) + prior.T @ prior
    return Fit(np.asarray(x), inverse @ meat @ inverse, scale)


def _slope(residual: Residual, x: FloatArray, k: int, step: float) -> FloatArray:
    """d residual / d x[k] by central differences, also at a bound."""
    up, down = x.copy(), x.copy()
    up[k], down[k] = x[k] + step, x[k] - step
    return (residual(up) - residual(down)) / (2.0 * step)
