"""Counters that wrap, made to run on.

The wire carries the low bits of counters that only ever grow. As long as
fewer than 2^bits counts pass between two readings, the difference modulo
2^bits is the true one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Unwrapper:
    """Follows one counter of ``bits`` bits."""

    __slots__ = ("_last", "_mask", "value")

    def __init__(self, bits: int) -> None:
        self._mask = (1 << bits) - 1
        self._last: int | None = None
        self.value = 0
        """Unwrapped count; starts at the first raw value."""

    def __call__(self, raw: int) -> int:
        """Unwrapped count at this reading."""
        if self._last is None:
            self.value = raw
        else:
            self.value += (raw - self._last) & self._mask
        self._last = raw
        return self.value

    def rebase(self, raw: int) -> None:
        """The counter restarted at ``raw``: keep the value, count on from here."""
        self._last = raw


def unwrap(raw: NDArray[np.unsignedinteger], bits: int) -> NDArray[np.int64]:
    """Unwrapped counts (N,) of successive raw readings (N,), as ``Unwrapper`` gives them."""
    wide = raw.astype(np.int64)
    if wide.size:
        wide[1:] = np.diff(wide) & ((1 << bits) - 1)
    return np.cumsum(wide)
