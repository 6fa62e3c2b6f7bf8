"""What a group is worth on recordings that no fit has seen.

    l_g^2 = sum rho(r) without g / sum rho(r) with all     g at its old value, all else fitted anew

r: whitened errors of the motion in the test recordings, rho: the loss of the fits, for a spin that
no model follows must not outweigh all the rest. All: the groups that are believed to have been
wrong. The 90 % interval of l_g is Student's, by batch means over n stretches u (or recordings):

    ln l_g +- t_(n-1) se / 2        se^2 = n / (n - 1) sum_u (A_u - R B_u)^2 / A^2,  R = A / B

with A, B the losses without g and with all. Neighbours within a stretch have much in common, so few
long ones say more truly how far other driving may be off than many short ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dart_hal.core.types import FloatArray
from dart_lab.identification.evaluation.compare import LEAST_BLOCKS

from ..result import Cost
from .sets import Set

LEVEL = 0.95  # quantile at the upper end of a 90 % interval


def cost(losses: Callable[[Set], FloatArray], every: Set, group: str | Set) -> Cost:
    """(l_g, its 90 % interval); losses: by stretch (or recording) with some groups free."""
    left = frozenset({group}) if isinstance(group, str) else group
    return ratio(losses(every), losses(every - left))


def ratio(with_all: FloatArray, without: FloatArray) -> Cost:
    """Of the root of two losses by stretch, with its 90 % interval; NaN with too few of them."""
    total = max(float(with_all.sum()), 1e-12)
    of_losses, n = float(without.sum()) / total, len(with_all)
    value = float(np.sqrt(of_losses))
    if n < LEAST_BLOCKS:
        return value, np.nan, np.nan
    from scipy.special import stdtrit  # takes 0.2 s, and where nothing is named nobody asks

    rest = without - of_losses * with_all
    error = float(np.sqrt(n / (n - 1) * (rest @ rest))) / max(without.sum(), 1e-12)
    reach = np.exp(0.5 * float(stdtrit(n - 1, LEVEL)) * error)
    return value, value / float(reach), value * float(reach)
