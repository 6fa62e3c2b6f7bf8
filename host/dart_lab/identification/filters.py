"""The paper's smoothing and differentiating, on plain rows.

Same figures as scipy.signal.savgol_filter, whose import alone would cost a
third of the time of all fits.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray


def smooth(values: FloatArray, points: int, order: int) -> FloatArray:
    """Savitzky-Golay smoothing (n,); the ends lie on the polynomial through the last points.

    An even number of points puts the result half a sample late: order 1 with
    20 points is the mean of the samples i-9 ... i+10, as in the paper's code.
    """
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
    """First derivative (n,) of the not-a-knot cubic spline through the samples."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, values)(t, 1))


def later(t: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """The values as they were ``delay`` [s] ago, by linear interpolation."""
    return np.asarray(np.interp(t - delay, t, values))
