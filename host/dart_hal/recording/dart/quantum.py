"""The speed of one encoder count, inferred from the values themselves.

The constant in the sketch changed between recording days, so pooling speeds
of several days needs the quantum of each file. Speeds are whole multiples of
it; files of January and February 2024 are rounded to 2 decimals besides.
"""

from __future__ import annotations

import numpy as np

from dart_hal.types import FloatArray

LOW, HIGH, STEP = 0.010, 0.12, 2e-5
MIN_VALUES = 6
COHERENCE = 0.8  # rounding of +-0.005 m/s at a quantum of 0.02 leaves about this much


def encoder_quantum(speed: FloatArray) -> float | None:
    """Speed of one count [m/s], or None when the values do not tell.

    speed (m,) m/s. Largest candidate for which the phases 2 pi v/q agree:
    every divisor of the quantum agrees too, no multiple does.
    """
    values = np.unique(np.round(speed[np.isfinite(speed) & (speed > 0.0)], 6))
    values = values[values < 3.0]
    if len(values) < MIN_VALUES:
        return None
    rounded = bool(np.all(np.abs(values * 100 - np.round(values * 100)) < 1e-3))
    candidates = np.arange(HIGH, LOW, -STEP)
    coherence = _coherence(values, candidates)
    good = np.flatnonzero(coherence > (COHERENCE if rounded else 0.95))
    if rounded:
        good = good[candidates[good] > 0.012]
    if len(good) == 0:
        return None
    top = good[good <= good[0] + 60]
    best = float(candidates[top[np.argmax(coherence[top])]])
    return _refine(values, best)


def _coherence(values: FloatArray, quanta: FloatArray) -> FloatArray:
    phase = 2.0 * np.pi * values[None, :] / quanta[:, None]
    return np.asarray(np.cos(phase).mean(axis=1))


def _refine(values: FloatArray, quantum: float) -> float:
    counts = np.round(values / quantum)
    return float((counts @ values) / (counts @ counts))
