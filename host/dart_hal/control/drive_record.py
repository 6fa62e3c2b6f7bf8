"""Record of a drive of any length: rows that get sparser, and the figures of all of them."""

from __future__ import annotations

from array import array
from math import nan, sqrt

import numpy as np

from dart_hal.core.types import FloatArray

# Numbers of a row: t, x, y, offset, speed, target speed, arc length.
ROW_LENGTH = 7
# Rows that are kept: five minutes at 100 Hz, 1.7 MB. Then every second one is dropped, and from
# then on half as many are added.
MAX_RECORDED_ROWS = 30_000


class DriveRecord:
    """Record of a drive.

    ``lap_times`` [s]: the first from the first motion on. ``table`` has at most
    ``MAX_RECORDED_ROWS`` rows, evenly spaced over the drive; the figures of the offset are those
    of every call since ``start_figures``, from which ``joined`` is the first row.
    """

    def __init__(self) -> None:
        self.lap_times: list[float] = []
        self.joined = 0
        self.offset_max = nan
        self._squares = 0.0
        self._count = 0
        self._values = array("d")
        # Every ``_stride``-th call becomes a row.
        self._stride = 1
        self._calls = 0

    def __len__(self) -> int:
        return len(self._values) // ROW_LENGTH

    def add(self, *row: float) -> None:
        """Add t [s], x, y, offset [m], speed, target speed [m/s] and arc length [m] of a call."""
        offset = abs(row[3])
        self._squares += offset * offset
        self._count += 1
        # Not max(): the first value replaces NaN.
        self.offset_max = self.offset_max if self.offset_max >= offset else offset
        if self._calls % self._stride == 0:
            self._values.extend(row)
            if len(self) == MAX_RECORDED_ROWS:
                self._values = array("d", self.table[::2].ravel())
                self._stride *= 2
                self.joined //= 2
        self._calls += 1

    def start_figures(self) -> None:
        """Begin the figures with the next call: the car was not yet in the lane."""
        self.joined = len(self)
        self.offset_max = nan
        self._squares = 0.0
        self._count = 0

    @property
    def offset_rms(self) -> float:
        """Root mean square of the offset [m]; NaN before the first call."""
        return sqrt(self._squares / self._count) if self._count else nan

    @property
    def table(self) -> FloatArray:
        """The rows as an array (n, 7)."""
        return np.array(self._values).reshape(-1, ROW_LENGTH)
