"""The speed of one encoder count, inferred from the values themselves.

The constant in the sketch changed between recording days, so pooling speeds
of several days needs the quantum of each file. Speeds are whole multiples of
it; files of January and February 2024 are rounded to 2 decimals besides.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

MIN_QUANTUM = 0.015
MAX_QUANTUM = 0.12
QUANTUM_STEP = 1e-5
MIN_VALUES = 5
MIN_ROUNDED = 8
ROUNDING = 0.0055  # m/s; half a unit of the second decimal and a little
MIN_MULTIPLE_SHARE = 0.98  # of the values must lie on the multiples
MAX_SPEED = 2.5  # m/s; the multiples of neighbouring candidates drift apart with speed


def encoder_quantum(speed: FloatArray) -> float | None:
    """Speed of one count [m/s], or None when the values do not tell.

    speed (m,) m/s. The largest candidate of which (nearly) all values are
    multiples: its divisors fit too, its multiples do not.
    """
    values = np.unique(np.round(speed[np.isfinite(speed) & (speed > 0.0)], 6))
    values = values[values < MAX_SPEED]
    cents = values * 100.0
    rounded = bool(np.all(np.abs(cents - np.round(cents)) < 1e-3))
    if len(values) < (MIN_ROUNDED if rounded else MIN_VALUES):
        return None
    candidates = np.arange(MAX_QUANTUM, MIN_QUANTUM, -QUANTUM_STEP)
    off = np.abs(values - candidates[:, None] * np.round(values / candidates[:, None]))
    tolerance = ROUNDING if rounded else np.maximum(0.02 * candidates, 1e-4)[:, None]
    fits = (off < tolerance).mean(axis=1) >= MIN_MULTIPLE_SHARE
    if not fits.any():
        return None
    first = int(np.argmax(fits))
    end = first + int(np.argmin(np.append(fits[first:], False)))
    best = first + int(np.argmin((off[first:end] ** 2).mean(axis=1)))
    counts = np.round(values / candidates[best])
    if not counts.any():
        return None
    return float((counts @ values) / (counts @ counts))
