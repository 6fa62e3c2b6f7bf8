"""Signals of the last steps, for sensors with an age or a window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dart_hal.vehicle.namespace import Value

# ``rows(k)``: the signals k steps ago.
Rows = Callable[[int], Sequence[Value]]


class History(Protocol):
    """The last steps of some signals."""

    def push(self, signals: Sequence[Value]) -> None:
        """Append the signals of a new step."""

    def fill(self, rows: Rows, lanes: Any = None) -> None:
        """Replace the history of all cars, or of those of an index array."""

    def value(self, signal: int, back: Value) -> Value:
        """Return a signal ``back`` steps ago, linear between steps."""


class ScalarHistory:
    """History of one car, in a ring buffer of tuples."""

    def __init__(self, depth: int) -> None:
        self._ring: list[Sequence[float]] = [()] * depth
        self._now = 0

    def push(self, signals: Sequence[Value]) -> None:
        self._now = (self._now + 1) % len(self._ring)
        self._ring[self._now] = signals

    def fill(self, rows: Rows, lanes: Any = None) -> None:
        depth = len(self._ring)
        for k in range(depth):
            self._ring[(self._now - k) % depth] = rows(k)

    def value(self, signal: int, back: Value) -> Value:
        # Between the signals k and k + 1 steps ago.
        k = int(back)
        part = back - k
        depth = len(self._ring)
        newer = self._ring[(self._now - k) % depth][signal]
        if part == 0.0:
            return newer
        return newer + part * (self._ring[(self._now - k - 1) % depth][signal] - newer)


class ArrayHistory:
    """History of many cars, in a ring buffer of arrays; ``back`` may be an array (n,)."""

    def __init__(self, depth: int, signals: int, n: int, dtype: Any) -> None:
        self._ring: NDArray[Any] = np.zeros((depth, signals, n), dtype=dtype)
        self._lanes = np.arange(n)
        self._now = 0

    def push(self, signals: Sequence[Value]) -> None:
        self._now = (self._now + 1) % len(self._ring)
        for row, new in zip(self._ring[self._now], signals, strict=True):
            row[...] = new

    def fill(self, rows: Rows, lanes: Any = None) -> None:
        depth = len(self._ring)
        where = slice(None) if lanes is None else lanes
        for k in range(depth):
            for row, new in zip(self._ring[(self._now - k) % depth], rows(k), strict=True):
                row[where] = np.broadcast_to(new, row.shape)[where]

    def value(self, signal: int, back: Value) -> Value:
        depth = len(self._ring)
        if isinstance(back, np.ndarray):
            k = back.astype(np.intp)
            newer = self._ring[(self._now - k) % depth, signal, self._lanes]
            older = self._ring[(self._now - k - 1) % depth, signal, self._lanes]
            return newer + (back - k) * (older - newer)
        k0 = int(back)
        newer = self._ring[(self._now - k0) % depth, signal]
        if back == k0:
            return newer
        return newer + (back - k0) * (self._ring[(self._now - k0 - 1) % depth, signal] - newer)
