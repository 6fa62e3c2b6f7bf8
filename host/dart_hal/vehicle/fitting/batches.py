"""Standard error of a mean of correlated samples, by batch means."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray

# Half-width of the central 90 % of a normal distribution in standard deviations, Phi^-1(0.95).
NORMAL_90 = 1.6449


def student_factor(groups: int) -> float:
    """Return by how much a standard error from the scatter of a few groups must be larger.

    Few groups estimate their own scatter poorly. The factor is the ratio of the 95 % quantiles of
    Student's t (groups - 1 degrees of freedom) and the normal distribution: 3.8 for 2 groups, 1.30
    for 5, 1.11 for 10. 1.645 standard errors to each side then still contain 90 %.
    """
    from scipy.special import stdtrit

    return float(stdtrit(max(groups - 1, 1), 0.95)) / NORMAL_90


def standard_error(means: FloatArray | Sequence[float]) -> FloatArray:
    """Compute the standard error of the mean of ``means`` (n, ...).

    Each value is the mean of a batch that is longer than the correlation time of its samples:
    s / sqrt(n), times ``student_factor``.
    """
    n = len(means)
    return np.asarray(student_factor(n) * np.std(means, axis=0, ddof=1) / math.sqrt(n))
