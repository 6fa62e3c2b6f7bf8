"""Places at which beams have ended for seconds although the map has nothing there: new boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.types import BoolArray, FloatArray

# m, side of a cell: three times the noise of a distance.
CELL = 0.05
# s between the first and the last beam of a cell at rest, longer than a foot rests, and scans in
# which beams ended in it.
MIN_REST_TIME = 2.0
MIN_REST_SCANS = 8
# s after its last beam at which a cell is forgotten.
MAX_REST_AGE = 10.0
# Key of a cell: column * ROW_KEYS + row, for rooms of up to 1600 m.
ROW_KEYS = 1 << 16
NEIGHBOUR_KEYS = np.array([ROW_KEYS * i + j for i in (-1, 0, 1) for j in (-1, 0, 1)])


class RestingPoints:
    """Call ``add`` with the unexplained points of each scan."""

    def __init__(self) -> None:
        self._first: dict[int, float] = {}
        self._last: dict[int, float] = {}
        self._count: dict[int, int] = {}
        self._resting: NDArray[np.int64] = np.empty(0, np.int64)

    def add(self, points: FloatArray, t: float) -> None:
        """Add points (n, 2) [m] of a scan at t [s]."""
        for key in set(_keys(points).tolist()):
            self._first.setdefault(key, t)
            self._last[key] = t
            self._count[key] = self._count.get(key, 0) + 1
        for key in [key for key, last in self._last.items() if t - last > MAX_REST_AGE]:
            del self._first[key], self._last[key], self._count[key]
        resting = [key for key, first in self._first.items()
                   if self._last[key] - first >= MIN_REST_TIME
                   and self._count[key] >= MIN_REST_SCANS]
        # Noise moves a point to a neighbouring cell.
        self._resting = (np.array(resting, np.int64)[:, None] + NEIGHBOUR_KEYS).ravel()

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points (n, 2) [m] are at a place of rest."""
        found: BoolArray = np.isin(_keys(points), self._resting)
        return found


def _keys(points: FloatArray) -> NDArray[np.int64]:
    """Return the keys (n,) of the cells of points (n, 2) [m]."""
    cells = np.floor(points / CELL).astype(np.int64)
    keys: NDArray[np.int64] = cells[:, 0] * ROW_KEYS + cells[:, 1]
    return keys
