"""The error of a mean whose samples are not independent: means of batches of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray

NORMAL_90 = 1.6449
"""Standard errors to either side that hold 90 % of a normal distribution."""


def standard_error(means: FloatArray | Sequence[float]) -> FloatArray:
    """Of the mean of ``means`` (n, ...), each of a batch longer than the memory of its samples.

    As few batches tell their own scatter badly, it is as wide as Student's t with n - 1 degrees
    of freedom needs for 90 %, so that 1.645 of it still hold 90 %: 1.11 for n = 10, 1.30 for 5.
    """
    from scipy.special import stdtrit

    n = len(means)
    student = stdtrit(n - 1, 0.95) / NORMAL_90
    return np.asarray(student * np.std(means, axis=0, ddof=1) / math.sqrt(n))
