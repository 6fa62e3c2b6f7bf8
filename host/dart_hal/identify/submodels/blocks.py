"""Which samples are taken as independent of which: whole recordings, or stretches of them."""

from __future__ import annotations

import numpy as np

from dart_hal.types import IntArray

MANY = 8  # recordings
LARGEST = 0.35  # of all samples in one recording; with more the others are no comparison


def independent_blocks(owner: IntArray, fine: IntArray) -> IntArray:
    """owner (n,): recording of each sample, if there are 8 and none holds most; else fine (n,)."""
    labels, count = np.unique(owner, return_counts=True)
    enough = len(labels) >= MANY and count.max() < LARGEST * count.sum()
    return np.asarray(owner if enough else fine, dtype=np.int64)
