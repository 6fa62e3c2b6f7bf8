"""Smoothing and differentiation of the paper, on plain rows.

Same numbers as scipy.signal.savgol_filter, whose import takes a third of the time of all fits.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray


def smooth(values: FloatArray, points: int, order: int) -> FloatArray:
    """Smooth (n,) by Savitzky-Golay; the ends are on the polynomial through the last points.

    An even number of points shifts the result by half a sample: order 1 with 20 points is the
    mean of the samples i-9 ... i+10, as in the paper's code.
    """
    # A smoothed value is the fitted polynomial at the middle of its points: fixed weights.
    half = points // 2
    middle = half if points % 2 else half - 0.5
    powers = np.vander(np.arange(points) - middle, order + 1)
    weights = np.linalg.pinv(powers)[-1]
    out = np.empty(len(values))
    first = half if points % 2 else half - 1
    inner = np.correlate(values, weights, mode="valid")
    out[first:first + len(inner)] = inner
    steps = np.arange(points)
    out[:half] = np.polyval(np.polyfit(steps, values[:points], order), steps[:half])
    out[-half:] = np.polyval(np.polyfit(steps, values[-points:], order), steps[-half:])
    return out


def slope(t: FloatArray, values: FloatArray) -> FloatArray:
    """Differentiate (n,): first derivative of the not-a-knot cubic spline through the samples."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, values)(t, 1))


def delay_values(t: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Delay the values by ``delay`` [s], by linear interpolation."""
    return np.asarray(np.interp(t - delay, t, values))
