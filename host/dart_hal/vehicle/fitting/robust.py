"""Robust scale and loss: a few wild samples must not decide a fit."""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation of a normal variable: 1 / 0.67449."""
ROBUST = 3.0
"""Times the scatter: a residual beyond it counts less than its square; normal ones never do."""


def scatter(x: FloatArray) -> float:
    """Standard deviation of residuals about zero, by the median of their sizes."""
    return MAD_TO_SIGMA * float(np.median(np.abs(x)))


def soft_l1(x: FloatArray, beyond: float | FloatArray) -> FloatArray:
    """Soft L1 loss: x^2 for |x| << beyond, 2 beyond |x| for |x| >> beyond.

    2 b^2 (sqrt(1 + (x / b)^2) - 1), scipy's ``soft_l1`` scaled so that it is
    the square near zero; ``beyond`` in the unit of x, a number (infinite: the
    square) or one per value.
    """
    if np.all(np.isinf(beyond)):
        return np.square(x)
    return np.asarray(2.0 * beyond**2 * (np.sqrt(1.0 + (x / beyond)**2) - 1.0))


def soft_l1_weight(x: FloatArray, beyond: float | FloatArray) -> FloatArray:
    """Weights of the least squares problem with the same gradient: 1 / sqrt(1 + (x / b)^2)."""
    return np.asarray(1.0 / np.sqrt(1.0 + (x / beyond)**2))
