"""Unwrap counters of limited width.

The wire carries the low bits of counters that never decrease. If the count increases by less than
2^bits between two readings, the difference modulo 2^bits is the true one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def unwrap(raw: NDArray[np.unsignedinteger], bits: int) -> NDArray[np.int64]:
    """Return the unwrapped counts (N,) of successive raw readings (N,)."""
    wide = raw.astype(np.int64)
    if wide.size:
        wide[1:] = np.diff(wide) & ((1 << bits) - 1)
    return np.cumsum(wide)
