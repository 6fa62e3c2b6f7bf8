"""Robust scale and loss: outliers have a limited influence on a fit."""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

# Standard deviation over median absolute deviation of a normal variable, 1 / Phi^-1(3/4) =
# 1 / 0.67449.
MAD_TO_SIGMA = 1.4826
# Scale of the soft L1 loss in standard deviations of the residuals: larger residuals, which are
# rare in a normal distribution, count less than their square.
SOFT_L1_STDS = 3.0


def scatter(x: FloatArray) -> float:
    """Estimate the standard deviation of residuals about zero from the median of |x|."""
    return MAD_TO_SIGMA * float(np.median(np.abs(x)))


def soft_l1(x: FloatArray, scale: float | FloatArray) -> FloatArray:
    """Return the soft L1 loss: x^2 for |x| << scale, 2 scale |x| for |x| >> scale.

    rho(x) = 2 b^2 (sqrt(1 + (x / b)^2) - 1) with b the scale: scipy's ``soft_l1``, multiplied so
    that it is the square near zero. scale: in the unit of x, a number (infinite: the square) or
    one per value.
    """
    if np.all(np.isinf(scale)):
        return np.square(x)
    return np.asarray(2.0 * scale**2 * (np.sqrt(1.0 + (x / scale)**2) - 1.0))


def soft_l1_weight(x: FloatArray, scale: float | FloatArray) -> FloatArray:
    """Return the weights of the least squares problem of equal gradient, rho'(x) / (2 x).

    w = 1 / sqrt(1 + (x / scale)^2)
    """
    return np.asarray(1.0 / np.sqrt(1.0 + (x / scale)**2))
