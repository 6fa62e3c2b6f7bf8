"""Cost of a group of parameters on recordings that no fit used.

    l_g^2 = sum rho(r) without g / sum rho(r) with all     g at its old value, the others refitted

r: whitened errors of the motion in the test recordings. rho: the robust loss of the fits, so that a
spin that no model follows does not dominate. All: the groups that were probably wrong. The 90 %
interval of l_g is Student's, by batch means over n stretches u (or recordings):

    ln l_g +- t_(n-1) se / 2        se^2 = n / (n - 1) sum_u (A_u - R B_u)^2 / A^2,  R = A / B

with A, B the losses without g and with all. Errors of one stretch are correlated, so a few long
stretches give a better interval for other driving than many short ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dart_hal.core.types import FloatArray
from dart_lab.identification.evaluation.compare import MIN_BLOCKS

from ..result import Cost
from .sets import GroupSet

INTERVAL_QUANTILE = 0.95  # quantile at the upper end of a 90 % interval


def group_cost(losses: Callable[[GroupSet], FloatArray], groups: GroupSet, group: str | GroupSet
               ) -> Cost:
    """Return l_g and its 90 % interval; losses: by stretch (or recording) with some groups free."""
    fixed = frozenset({group}) if isinstance(group, str) else group
    return loss_ratio(losses(groups), losses(groups - fixed))


def loss_ratio(with_all: FloatArray, removed: FloatArray) -> Cost:
    """Return the root of the ratio of two losses by stretch, and its 90 % interval.

    The interval is NaN with too few stretches.
    """
    total = max(float(with_all.sum()), 1e-12)
    quotient = float(removed.sum()) / total
    n = len(with_all)
    value = float(np.sqrt(quotient))
    if n < MIN_BLOCKS:
        return value, np.nan, np.nan
    from scipy.special import stdtrit  # the import takes 0.2 s, and many diagnoses do not need it

    rest = removed - quotient * with_all
    error = float(np.sqrt(n / (n - 1) * (rest @ rest))) / max(removed.sum(), 1e-12)
    reach = np.exp(0.5 * float(stdtrit(n - 1, INTERVAL_QUANTILE)) * error)
    return value, value / float(reach), value * float(reach)
