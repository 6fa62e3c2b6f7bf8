"""Who sees a target, when, and what share of the area is seen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.core.types import BoolArray, FloatArray


def seen(robots: FloatArray, targets: FloatArray, radius: float) -> BoolArray:
    """Whether a target (..., 2) [m] is within the radius [m] of one of the robots (..., n, 2)."""
    away = robots - targets[..., None, :]
    return np.asarray((np.sum(away * away, axis=-1) <= radius * radius).any(axis=-1))


def first_seen(t: FloatArray, robots: FloatArray, target: FloatArray, radius: float) -> float:
    """The first time [s] of t (k,) at which a target (k, 2) is seen by robots (k, n, 2); inf."""
    hit = np.flatnonzero(seen(robots, target, radius))
    return float(t[hit[0]]) if len(hit) else float("inf")


def coverage(curve: Lissajous, robots: FloatArray, radius: float, cells: int = 60
             ) -> tuple[FloatArray, float]:
    """Share of the area seen at each time (k,), and share seen at any of them, by robots
    (k, n, 2) [m] that see as far as the radius [m]; of cells x cells places."""
    edge = (np.arange(cells) + 0.5) / cells * 2.0 - 1.0
    x, y = np.meshgrid(curve.A * edge, curve.B * edge)
    spots = np.stack([x.ravel(), y.ravel()], axis=-1)
    now = np.array([seen(each, spots, radius) for each in robots])
    return now.mean(axis=1), float(now.any(axis=0).mean())


def hiding(curve: Lissajous, robots: FloatArray, radius: float, cells: int = 81
           ) -> Iterator[BoolArray]:
    """Where a target that was not seen yet may be, (cells, cells) of y and x, at each time: robots
    (k, n, 2) [m]. However fast it is and whatever it knows, it is in what is free of the robots'
    discs and connected, across corners too, with where it may have been before."""
    from scipy.ndimage import label

    edge = np.linspace(-1.0, 1.0, cells)
    spots = np.stack(np.meshgrid(curve.A * edge, curve.B * edge), axis=-1)
    may_be = np.ones((cells, cells), dtype=bool)
    for each in robots:
        free = ~seen(each, spots, radius)
        regions, _ = label(free, np.ones((3, 3)))
        may_be = free & np.isin(regions, np.unique(regions[may_be & free]))
        yield may_be


def cleared(curve: Lissajous, t: FloatArray, robots: FloatArray, radius: float, cells: int = 81
            ) -> float:
    """The time [s] of t (k,) from which on no target is unseen, as ``hiding``; inf."""
    for now, may_be in zip(t, hiding(curve, robots, radius, cells), strict=True):
        if not may_be.any():
            return float(now)
    return float("inf")
