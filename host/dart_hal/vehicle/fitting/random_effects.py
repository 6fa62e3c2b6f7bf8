"""Random effects: the mean of groups that differ by more than their own standard errors.

Group i has an estimate x_i with variance v_i. The model is x_i = mean + u_i + e_i with
var(e_i) = v_i and an unknown variance between groups, var(u_i) = tau^2. The estimate of tau^2 is
that of DerSimonian and Laird (1986):

    w_i = 1 / v_i,     mean = sum(w x) / sum(w),     Q = sum(w (x - mean)^2)
    tau^2 = max(0, (Q - (n - 1)) / (sum(w) - sum(w^2) / sum(w)))
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

# Standard error over value; less certain groups are left out of the variance between groups.
MAX_RELATIVE_STD = 0.3


def between_variance(x: FloatArray, variance: FloatArray) -> float:
    """Estimate the variance between groups x (s,) whose own variances are (s,)."""
    if len(x) < 2:
        return 0.0
    weight = 1.0 / variance
    # Q has the expectation n - 1 + tau^2 (sum(w) - sum(w^2) / sum(w)): solved for tau^2.
    off = x - weight @ x / weight.sum()
    spare = weight.sum() - (weight**2).sum() / weight.sum()
    return max(0.0, float((weight @ off**2 - len(x) + 1) / spare))


def random_effects(x: FloatArray, covariance: FloatArray
                   ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Average estimates x (s, k) of covariance (s, k, k), weighted by (covariance + tau^2)^-1.

    Returns the mean (k,), its covariance (k, k) and the variance between groups tau^2 (k,). The
    covariance is multiplied by chi^2 / freedom where that is above 1.
    """
    between = _between_variances(x, covariance)
    precision = np.linalg.inv(covariance + np.diag(between))
    total = np.linalg.inv(precision.sum(axis=0))
    mean = total @ np.einsum("dij,dj->i", precision, x)
    off = x - mean
    # Scatter that the covariances do not explain widens that of the mean.
    chi2 = float(np.einsum("di,dij,dj->", off, precision, off))
    freedom = max((len(x) - 1) * x.shape[1], 1)
    return np.asarray(mean), np.asarray(total * max(1.0, chi2 / freedom)), between


def _between_variances(x: FloatArray, covariance: FloatArray) -> FloatArray:
    """Estimate the variance (k,) between groups, parameter by parameter."""
    out = np.zeros(x.shape[1])
    for i in range(x.shape[1]):
        own = covariance[:, i, i]
        known = np.sqrt(own) < MAX_RELATIVE_STD * np.maximum(np.abs(x[:, i]), 1e-3)
        if known.sum() < 2:
            continue
        out[i] = between_variance(x[known, i], own[known])
    return out
