"""Waves: a wheel that is not round comes again along the way, planks and cables across the floor.

What comes again with every metre is no function of speed or steering, and of place
only a very wavy one. Its power at every length is a product of sums over blocks, so
the signs of whole blocks are turned as for any function.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dart_hal.types import FloatArray

from .rows import Labels

ComplexArray = NDArray[np.complex64]

WAVES = "waves"
ALONG = (("way", WAVES), ("x", WAVES), ("y", WAVES))
"""What waves are looked for along; they stand beside sets of variables."""
FASTEST = 1.5  # waves per metre: a prediction takes half a metre together
FINE, FINER = 1.5, 8.0
"""Frequencies for each that the longest way can tell apart: to find a wave, to tell its length."""
MOST = 600  # frequencies
FEWEST = 3.0  # waves on the longest way


def phases(name: str, recording: Labels) -> Labels:
    """(n,) labels of rows whose waves begin together: on one floor all do, along the way those of
    a recording."""
    return recording if name == "way" else np.zeros_like(recording)


def waves(y: FloatArray, block: Labels, way: FloatArray, recording: Labels, signs: FloatArray
          ) -> FloatArray:
    """Share (s, c) of the best wave along the way, each recording with a phase of its own.

    y (n, c) in blocks (n,), for each set of signs (s, B); way (n,) [m], or a place;
    recording (n,) as ``phases``. Of the variance, less what any wave takes of noise.
    """
    tried = frequencies(way, recording)
    if not len(tried):
        return np.zeros((len(signs), y.shape[1]))
    n, free = len(way), 2 * len(np.unique(recording))  # an amplitude and a phase of each
    taken = np.zeros((y.shape[1], len(signs), len(tried)), dtype=np.float32)
    for mine, of, spectra in _spectra(y, block, way, recording, tried):
        for i, one in enumerate(spectra):
            turned = signs[:, mine].astype(np.complex64) @ one
            taken[i] += 2.0 / of * np.abs(turned)**2
    share = taken.max(axis=2).T / np.maximum((y**2).sum(axis=0), 1e-12)
    return np.asarray(1.0 - (1.0 - share) * (n - 1.0) / max(n - 1.0 - free, 1.0), dtype=float)


def wave(y: FloatArray, way: FloatArray, recording: Labels) -> tuple[float, float]:
    """(length [m], amplitude) of the best wave of y (n,) along the way (n,)."""
    tried = frequencies(way, recording, FINER)
    taken = sum(2.0 / of * np.abs(one[0].sum(axis=0))**2
                for _, of, one in _spectra(y[:, None], recording, way, recording, tried))
    best = int(np.argmax(taken))
    return float(1.0 / tried[best]), float(np.sqrt(2.0 * np.asarray(taken)[best] / len(y)))


def frequencies(way: FloatArray, recording: Labels, fine: float = FINE) -> FloatArray:
    """(f,) waves per metre that are tried; none where the way is too short for any."""
    longest = max((float(np.ptp(way[recording == r])) for r in np.unique(recording)), default=0.0)
    if longest * FASTEST < FEWEST:
        return np.empty(0)
    return np.arange(FEWEST / longest, FASTEST, max(1.0 / (fine * longest), FASTEST / MOST))


def _spectra(y: FloatArray, block: Labels, way: FloatArray, recording: Labels, tried: FloatArray
             ) -> Iterator[tuple[Labels, int, ComplexArray]]:
    """Of each recording: its blocks (b,), its rows, and their sums at each frequency (c, b, f)."""
    for one in np.unique(recording):
        mine = np.flatnonzero(recording == one)
        blocks = np.unique(block[mine])
        parts = [mine[block[mine] == b] for b in blocks]
        yield blocks, len(mine), np.stack(
            [y[p].T.astype(np.complex64)
             @ np.exp(2j * np.pi * np.outer(way[p], tried)).astype(np.complex64)
             for p in parts], axis=1)
