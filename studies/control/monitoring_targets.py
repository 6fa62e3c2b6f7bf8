"""Targets that do not want to be seen.

One is as fast as it likes, cannot pass through what is seen, and knows where the robots will be
next: it goes where it will still be free, mostly to the largest part of that.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.ndimage import label

from dart_hal.control.monitoring.detection import is_detected
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.core.types import FloatArray, IntArray


def parts_of(curve: Lissajous, robots: FloatArray, radius: float, cells: int = 61
             ) -> list[IntArray]:
    """Number of the connected part of each place (cells * cells,) that is free, 0 where it is seen,
    at each step of robots (k, n, 2) [m] that see as far as the radius [m]."""
    edge = np.linspace(-1.0, 1.0, cells)
    spots = np.stack(np.meshgrid(curve.A * edge, curve.B * edge), axis=-1).reshape(-1, 2)
    return [
        label(~is_detected(one, spots, radius).reshape(cells, cells), np.ones((3, 3)))[0].ravel()
        for one in robots
    ]


def seen_at(parts: list[IntArray], at: int, rng: np.random.Generator) -> float:
    """The step at which nowhere is left to go to from place ``at``; inf: never."""
    if not parts[0][at]:
        return 0
    for k, (here, then) in enumerate(pairwise(parts)):
        open_ = np.flatnonzero((here == here[at]) & (then > 0))
        if not len(open_):
            return k + 1
        size = np.bincount(then)[then[open_]]
        best = open_[size == size.max()]
        at = int(rng.choice(best if rng.random() < 0.8 else open_))
    return np.inf


def moving(parts: list[IntArray], n: int, rng: np.random.Generator) -> FloatArray:
    """Steps (n,) at which random targets are seen, of those that are not at once; inf: never. None
    where all places are."""
    free = np.flatnonzero(parts[0])
    places = rng.choice(free, n) if len(free) else []
    return np.array([seen_at(parts, int(at), rng) for at in places])
