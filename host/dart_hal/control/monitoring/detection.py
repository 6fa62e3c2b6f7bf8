"""Detection of targets: when, and which share of the area is observed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.core.types import BoolArray, FloatArray


def is_detected(robots: FloatArray, targets: FloatArray, radius: float) -> BoolArray:
    """Return whether a target (..., 2) [m] is within the radius [m] of one of the robots (..., n,
    2).
    """
    difference = robots - targets[..., None, :]
    return np.asarray((np.sum(difference * difference, axis=-1) <= radius * radius).any(axis=-1))


def coverage(curve: Lissajous, robots: FloatArray, radius: float, cells: int = 60
             ) -> tuple[FloatArray, float]:
    """Return the observed share of the area at each time (k,), and the share observed at any time.

    robots (k, n, 2) [m]: positions; radius [m]: of their sensors; cells: resolution of both axes.
    """
    edge = (np.arange(cells) + 0.5) / cells * 2.0 - 1.0
    x, y = np.meshgrid(curve.A * edge, curve.B * edge)
    points = np.stack([x.ravel(), y.ravel()], axis=-1)
    observed = np.array([is_detected(positions, points, radius) for positions in robots])
    return observed.mean(axis=1), float(observed.any(axis=0).mean())


def hidden_regions(curve: Lissajous, robots: FloatArray, radius: float, cells: int = 81
                   ) -> Iterator[BoolArray]:
    """Yield where a target that was not detected yet may be, (cells, cells) of y and x, at each
    time.

    robots (k, n, 2) [m]. The target may move arbitrarily fast and know everything: it may be in all
    cells outside the robots' discs that are connected, also diagonally, with its former region.
    """
    from scipy.ndimage import label

    edge = np.linspace(-1.0, 1.0, cells)
    points = np.stack(np.meshgrid(curve.A * edge, curve.B * edge), axis=-1)
    may_be = np.ones((cells, cells), dtype=bool)
    for positions in robots:
        free = ~is_detected(positions, points, radius)
        regions, _ = label(free, np.ones((3, 3)))
        may_be = free & np.isin(regions, np.unique(regions[may_be & free]))
        yield may_be


def clearing_time(
    curve: Lissajous, t: FloatArray, robots: FloatArray, radius: float, cells: int = 81
) -> float:
    """Return the time [s] of t (k,) from which on every target was detected, or inf."""
    for now, may_be in zip(t, hidden_regions(curve, robots, radius, cells), strict=True):
        if not may_be.any():
            return float(now)
    return float("inf")


# Name of version 0.1.
hiding = hidden_regions
