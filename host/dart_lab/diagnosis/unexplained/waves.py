"""Waves in the residuals: periodic with the distance (wheel not round) or with the place (planks).

Periodogram of residuals y over distance s, each recording r with a phase of its own:

    share(f) = sum_r 2 / n_r |sum_(i in r) y_i exp(2 pi j f s_i)|^2 / |y|^2

The inner sums are kept by block, so that the signs of whole blocks can be flipped.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.types import FloatArray, IntArray

ComplexArray = NDArray[np.complex64]

WAVES = "waves"
# Variables along which waves are searched, in the form of the sets of variables.
WAVE_SETS = (("way", WAVES), ("x", WAVES), ("y", WAVES))
# Frequencies per resolved frequency of the longest distance: to find a wave, to measure it.
SEARCH_OVERSAMPLING = 1.5
LENGTH_OVERSAMPLING = 8.0
MAX_FREQUENCIES = 600
MIN_WAVES = 3.0  # over the longest distance


def phase_labels(name: str, recording: IntArray) -> IntArray:
    """Labels (n,) of rows with a common phase: per recording for the distance, all for a place."""
    return recording if name == "way" else np.zeros_like(recording)


def wave_shares(y: FloatArray, block: IntArray, distance: FloatArray, recording: IntArray,
                signs: FloatArray, most: float) -> FloatArray:
    """Share (s, c) of the variance explained by the best wave, with a phase per recording.

    y (n, c): residuals in blocks (n,), for each set of signs (s, B). distance (n,) [m], or a place.
    recording (n,): see ``phase_labels``. most: waves per metre. Corrected for what
    any wave explains of noise.
    """
    frequencies = wave_frequencies(distance, recording, most)
    if not len(frequencies):
        return np.zeros((len(signs), y.shape[1]))
    # an amplitude and a phase of each
    n = len(distance)
    free = 2 * len(np.unique(recording))
    power = np.zeros((y.shape[1], len(signs), len(frequencies)), dtype=np.float32)
    for rows, count, spectra in _spectra(y, block, distance, recording, frequencies):
        for i, one in enumerate(spectra):
            flipped = signs[:, rows].astype(np.complex64) @ one
            power[i] += 2.0 / count * np.abs(flipped)**2
    share = power.max(axis=2).T / np.maximum((y**2).sum(axis=0), 1e-12)
    # Adjusted share: each wave has two free parameters per recording.
    return np.asarray(1.0 - (1.0 - share) * (n - 1.0) / max(n - 1.0 - free, 1.0), dtype=float)


def find_wave(y: FloatArray, distance: FloatArray, recording: IntArray, most: float
              ) -> tuple[float, float]:
    """Find the best wave of y (n,) along the distance (n,): (length [m], amplitude).

    most: waves per metre.
    """
    frequencies = wave_frequencies(distance, recording, most, LENGTH_OVERSAMPLING)
    power = sum(2.0 / count * np.abs(one[0].sum(axis=0))**2
                for _, count, one in _spectra(y[:, None], recording, distance, recording,
                                              frequencies))
    best = int(np.argmax(power))
    return float(1.0 / frequencies[best]), float(np.sqrt(2.0 * np.asarray(power)[best] / len(y)))


def wave_frequencies(distance: FloatArray, recording: IntArray, most: float,
                     oversampling: float = SEARCH_OVERSAMPLING) -> FloatArray:
    """Frequencies (f,) to try, up to ``most`` waves per metre; empty for too short a distance."""
    longest = max((float(np.ptp(distance[recording == r])) for r in np.unique(recording)),
                  default=0.0)
    if longest * most < MIN_WAVES:
        return np.empty(0)
    step = max(1.0 / (oversampling * longest), most / MAX_FREQUENCIES)
    return np.arange(MIN_WAVES / longest, most, step)


def _spectra(y: FloatArray, block: IntArray, distance: FloatArray, recording: IntArray,
             frequencies: FloatArray) -> Iterator[tuple[IntArray, int, ComplexArray]]:
    """For each recording: its blocks (b,), number of rows, and sums at each frequency (c, b, f)."""
    for one in np.unique(recording):
        rows = np.flatnonzero(recording == one)
        blocks = np.unique(block[rows])
        parts = [rows[block[rows] == b] for b in blocks]
        yield blocks, len(rows), np.stack(
            [y[p].T.astype(np.complex64)
             @ np.exp(2j * np.pi * np.outer(distance[p], frequencies)).astype(np.complex64)
             for p in parts], axis=1)
