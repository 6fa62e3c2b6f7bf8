"""Means over groups that differ by more than their own errors: the difference is an error too."""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

KNOWN = 0.3  # std over value of a group that takes part in the variance between them


def between_variance(x: FloatArray, variance: FloatArray) -> float:
    """Variance between x (s,) beyond their own (s,), by DerSimonian and Laird."""
    if len(x) < 2:
        return 0.0
    weight = 1.0 / variance
    off = x - weight @ x / weight.sum()
    spare = weight.sum() - (weight**2).sum() / weight.sum()
    return max(0.0, float((weight @ off**2 - len(x) + 1) / spare))


def random_effects(x: FloatArray, covariance: FloatArray
                   ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(mean (k,), covariance (k, k), variance between (k,)) of x (s, k) with (s, k, k).

    Each group weighs by its own covariance plus the spread between them.
    """
    between = _between(x, covariance)
    precision = np.linalg.inv(covariance + np.diag(between))
    total = np.linalg.inv(precision.sum(axis=0))
    mean = total @ np.einsum("dij,dj->i", precision, x)
    off = x - mean
    chi2 = float(np.einsum("di,dij,dj->", off, precision, off))
    freedom = max((len(x) - 1) * x.shape[1], 1)
    return np.asarray(mean), np.asarray(total * max(1.0, chi2 / freedom)), between


def _between(x: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance (k,) between groups beyond what their own errors explain."""
    out = np.zeros(x.shape[1])
    for i in range(x.shape[1]):
        own = covariance[:, i, i]
        known = np.sqrt(own) < KNOWN * np.maximum(np.abs(x[:, i]), 1e-3)
        if known.sum() < 2:
            continue
        out[i] = between_variance(x[known, i], own[known])
    return out
