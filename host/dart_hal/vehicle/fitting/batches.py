"""Standard error of a mean of correlated samples, by batch means."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray

# Half-width of the central 90 % of a normal distribution in standard deviations, Phi^-1(0.95).
NORMAL_90 = 1.6449


def standard_error(means: FloatArray | Sequence[float]) -> FloatArray:
    """Compute the standard error of the mean of ``means`` (n, ...).

    Each value is the mean of a batch that is longer than the correlation time of its samples. Few
    batches estimate their own scatter poorly, so s / sqrt(n) is multiplied by the ratio of the
    95 % quantiles of Student's t (n - 1 degrees of freedom) and the normal distribution: 1.11 for
    n = 10, 1.30 for n = 5. 1.645 standard errors to each side then still contain 90 %.
    """
    from scipy.special import stdtrit

    n = len(means)
    student = stdtrit(n - 1, 0.95) / NORMAL_90
    return np.asarray(student * np.std(means, axis=0, ddof=1) / math.sqrt(n))
