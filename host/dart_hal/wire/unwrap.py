"""Unwrap counters of limited width.

The wire carries the low bits of counters that never decrease. If the count increases by less than
2^bits between two readings, the difference modulo 2^bits is the true one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Unwrapper:
    """Unwraps one counter of ``bits`` bits."""

    __slots__ = ("_last", "_mask", "value")

    def __init__(self, bits: int) -> None:
        self._mask = (1 << bits) - 1
        self._last: int | None = None
        self.value = 0
        """Unwrapped count; starts at the first raw value."""

    def __call__(self, raw: int) -> int:
        """Return the unwrapped count at this reading."""
        if self._last is None:
            self.value = raw
        else:
            self.value += (raw - self._last) & self._mask
        self._last = raw
        return self.value

    def rebase(self, raw: int) -> None:
        """Continue from the present value after a restart of the counter at ``raw``."""
        self._last = raw


def unwrap(raw: NDArray[np.unsignedinteger], bits: int) -> NDArray[np.int64]:
    """Return the unwrapped counts (N,) of successive raw readings (N,), as by ``Unwrapper``."""
    wide = raw.astype(np.int64)
    if wide.size:
        wide[1:] = np.diff(wide) & ((1 << bits) - 1)
    return np.cumsum(wide)
