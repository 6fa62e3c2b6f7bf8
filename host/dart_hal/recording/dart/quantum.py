"""The speed of one encoder count, inferred from the speeds of a file.

The constant in the sketch changed between recording days, so pooling speeds of several days needs
the quantum of each file. Speeds are whole multiples of it; files of January and February 2024 are
also rounded to 2 decimals.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

MIN_QUANTUM = 0.015
MAX_QUANTUM = 0.12
QUANTUM_STEP = 1e-5
MIN_VALUES = 5
MIN_ROUNDED = 8
# Half a unit of the second decimal, and a small tolerance [m/s].
ROUNDING = 0.0055
# Share of the values that must be multiples of the quantum.
MIN_MULTIPLE_SHARE = 0.98
# Speeds that are used [m/s]: the multiples of two candidates differ more, the larger they are.
MAX_QUANTUM_SPEED = 2.5


def encoder_quantum(speed: FloatArray) -> float | None:
    """Infer the speed of one count [m/s]; None if the values do not identify it.

    speed (m,) m/s.

    1. Try candidates on a grid. The largest one of which nearly all values are multiples is the
       quantum: its divisors fit too, its multiples do not.
    2. Of the interval of candidates that fit, take the one with the smallest squared residual.
    3. Refine it by least squares: with the counts n_i, quantum = sum n_i v_i / sum n_i^2.
    """
    values = np.unique(np.round(speed[np.isfinite(speed) & (speed > 0.0)], 6))
    values = values[values < MAX_QUANTUM_SPEED]
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
