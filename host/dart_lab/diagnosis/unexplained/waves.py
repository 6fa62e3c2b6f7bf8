"""Waves: a wheel that is not round repeats with the distance driven, planks and cables with place.

Periodogram of residuals y over distance s, each recording r with a phase of its own:

    share(f) = sum_r 2 / n_r |sum_(i in r) y_i exp(2 pi j f s_i)|^2 / |y|^2

The inner sums are kept by block, so the signs of whole blocks are turned as for any function.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.types import FloatArray, IntArray

ComplexArray = NDArray[np.complex64]

WAVES = "waves"
ALONG = (("way", WAVES), ("x", WAVES), ("y", WAVES))
"""What waves are looked for along; they stand beside sets of variables."""
FASTEST = 1.5  # waves per metre: a prediction takes half a metre together
FINE, FINER = 1.5, 8.0
"""Frequencies for each that the longest distance resolves: to find a wave, to tell its length."""
MAX_FREQUENCIES = 600  # frequencies
FEWEST = 3.0  # waves on the longest distance


def phases(name: str, recording: IntArray) -> IntArray:
    """(n,) labels of rows whose waves begin together: on one floor all do, with the
    distance driven those of a recording."""
    return recording if name == "way" else np.zeros_like(recording)


def waves(y: FloatArray, block: IntArray, distance: FloatArray, recording: IntArray,
          signs: FloatArray) -> FloatArray:
    """Share (s, c) of the best wave, each recording with a phase of its own.

    y (n, c) in blocks (n,), for each set of signs (s, B); distance (n,) [m], or a place;
    recording (n,) as ``phases``. Of the variance, less what any wave takes of noise.
    """
    tried = frequencies(distance, recording)
    if not len(tried):
        return np.zeros((len(signs), y.shape[1]))
    n, free = len(distance), 2 * len(np.unique(recording))  # an amplitude and a phase of each
    taken = np.zeros((y.shape[1], len(signs), len(tried)), dtype=np.float32)
    for mine, of, spectra in _spectra(y, block, distance, recording, tried):
        for i, one in enumerate(spectra):
            turned = signs[:, mine].astype(np.complex64) @ one
            taken[i] += 2.0 / of * np.abs(turned)**2
    share = taken.max(axis=2).T / np.maximum((y**2).sum(axis=0), 1e-12)
    return np.asarray(1.0 - (1.0 - share) * (n - 1.0) / max(n - 1.0 - free, 1.0), dtype=float)


def wave(y: FloatArray, distance: FloatArray, recording: IntArray) -> tuple[float, float]:
    """(length [m], amplitude) of the best wave of y (n,) along the distance (n,)."""
    tried = frequencies(distance, recording, FINER)
    taken = sum(2.0 / of * np.abs(one[0].sum(axis=0))**2
                for _, of, one in _spectra(y[:, None], recording, distance, recording, tried))
    best = int(np.argmax(taken))
    return float(1.0 / tried[best]), float(np.sqrt(2.0 * np.asarray(taken)[best] / len(y)))


def frequencies(distance: FloatArray, recording: IntArray, fine: float = FINE) -> FloatArray:
    """(f,) waves per metre that are tried; none where the distance is too short for any."""
    longest = max((float(np.ptp(distance[recording == r])) for r in np.unique(recording)),
                  default=0.0)
    if longest * FASTEST < FEWEST:
        return np.empty(0)
    step = max(1.0 / (fine * longest), FASTEST / MAX_FREQUENCIES)
    return np.arange(FEWEST / longest, FASTEST, step)


def _spectra(y: FloatArray, block: IntArray, distance: FloatArray, recording: IntArray,
             tried: FloatArray) -> Iterator[tuple[IntArray, int, ComplexArray]]:
    """Of each recording: its blocks (b,), its rows, and their sums at each frequency (c, b, f)."""
    for one in np.unique(recording):
        mine = np.flatnonzero(recording == one)
        blocks = np.unique(block[mine])
        parts = [mine[block[mine] == b] for b in blocks]
        yield blocks, len(mine), np.stack(
            [y[p].T.astype(np.complex64)
             @ np.exp(2j * np.pi * np.outer(distance[p], tried)).astype(np.complex64)
             for p in parts], axis=1)
