"""Intervals of a recording that may be evaluated, if others are held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray, IntArray

# (begin, end) [s] on the clock of the messages' arrival, in order of time; empty: no limit.
Spans = Sequence[tuple[float, float]]


def span_index(spans: Spans, t: FloatArray) -> IntArray:
    """Return the index of the span of each time (n,) [s]; -1 outside of all."""
    if not spans:
        return np.zeros(len(t), dtype=np.int64)
    begins = np.array([begin for begin, _ in spans])
    ends = np.array([end for _, end in spans])
    index = np.searchsorted(begins, t, side="right") - 1
    inside = (index >= 0) & (t <= ends[np.maximum(index, 0)])
    return np.asarray(np.where(inside, index, -1), dtype=np.int64)
