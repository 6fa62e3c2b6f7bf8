"""What a group is worth on recordings that no fit has seen, and its share among the claimed ones.

    l_g^2 = sum rho(r) without g / sum rho(r) with all     g at its old value, all else fitted anew
    share_g = Shapley value of g in -sum rho(r) over subsets of the claimed groups, of all of it

r: whitened errors of the motion in the test recordings, rho: the loss of the fits, for a spin that
no model follows must not outweigh all the rest; the 90 % interval of l_g is a bootstrap over
blocks (or recordings). All: the groups that are believed to have been wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from math import factorial

import numpy as np

from dart_hal.evaluate.compare import LEAST_BLOCKS, draws
from dart_hal.types import FloatArray

from .sets import Set

LEVEL = (0.05, 0.95)  # quantiles of a 90 % interval

Cost = tuple[float, float, float]
"""A ratio of errors, and the ends of its interval."""


def cost(losses: Callable[[Set], FloatArray], every: Set, group: str | Set, seed: int) -> Cost:
    """(l_g, its 90 % interval); losses: by block (or recording) with some groups free."""
    left = frozenset({group}) if isinstance(group, str) else group
    return ratio(losses(every), losses(every - left), seed)


def ratio(with_all: FloatArray, without: FloatArray, seed: int) -> Cost:
    """Of the root of two losses by block, with its 90 % interval; NaN with too few blocks."""
    value = float(np.sqrt(without.sum() / max(with_all.sum(), 1e-12)))
    if len(with_all) < LEAST_BLOCKS:
        return value, np.nan, np.nan
    count = draws(np.arange(len(with_all)), seed=seed)
    drawn = np.sqrt((count @ without) / np.maximum(count @ with_all, 1e-12))
    low, high = np.quantile(drawn, LEVEL)
    return value, float(low), float(high)


def shapley(value: Mapping[Set, float], groups: Sequence[str]) -> dict[str, float]:
    """Shares of value(all) - value(none); value: of every subset of the groups."""
    n = len(groups)
    out = {}
    for g in groups:
        others = [o for o in groups if o != g]
        out[g] = sum(factorial(k) * factorial(n - k - 1) / factorial(n)
                     * (value[frozenset({*s, g})] - value[frozenset(s)])
                     for k in range(n) for s in combinations(others, k))
    total = value[frozenset(groups)] - value[frozenset()]
    return {g: v / total if total else 0.0 for g, v in out.items()}
