"""Null distribution of the largest gain: what chance explains if no effect is missing.

Wild bootstrap (Wu 1986; Mammen 1993): each block b of the residuals q, after subtraction of the
best explanation, is multiplied by a normal number n_b. This keeps the disturbance and its
correlation and removes any cause. For effect a with projected direction d = P (r_a - r):

    s_ab = sum_(i in b) w_i omega_i d_i q_i                score of a block
    f_a  = max(1, sum_b s_ab^2 / sum_i w_i omega_i d_i^2)  inflation over independent residuals
    T_a  = (sum_b n_b s_ab)^2 / sum_b s_ab^2               gain over inflation, one draw of n
    Q    = quantile 1 - alpha of max_a T_a                 one threshold for the whole family
    significant if gain(a) > f_a max(Q, Phi^-1(1 - alpha / 2m)^2),  m effects

Random signs instead of normal numbers would have too few combinations on few blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_lab.identification.objective import Point

from .scan import Trial

# Weighted square of a change of the residuals below which it consists of rounding errors.
MIN_SQUARED_CHANGE = 1e-6
# Data sets without a cause: 20 of them beyond a false alarm of 1 %.
NULL_DRAWS = 1999


@dataclass(frozen=True, slots=True)
class NullDistribution:
    """Distribution of the gains of effects if no effect is missing.

    inflation: by effect, its mean gain relative to that for independent residuals.
    best (draws,): largest gain of any effect over its inflation, in each simulated data set,
    ascending.
    """

    inflation: Mapping[str, float]
    best: FloatArray

    def p_value(self, effect: str, gain: float) -> float:
        """Share of the null data sets in which any effect has at least this gain."""
        return p_value(gain / self.inflation.get(effect, 1.0), self.best)

    def gain_thresholds(self, effects: Sequence[str], false_alarm: float) -> dict[str, float]:
        """By effect, the gain that is exceeded in a share ``false_alarm`` of the null data sets.

        At least the Bonferroni threshold for independent normal residuals: residuals without any
        noise would give a threshold of 0.
        """
        share = false_alarm / max(len(self.inflation), 1)
        independent = NormalDist().inv_cdf(1.0 - 0.5 * share)**2  # chi-square
        limit = max(float(np.quantile(self.best, 1.0 - false_alarm)), independent)
        return {name: self.inflation.get(name, 1.0) * limit for name in effects}


def simulate_null(point: Point, residual: FloatArray, trials: Sequence[Trial], block: IntArray,
                  seed: int, per_effect: bool = True) -> NullDistribution:
    """Simulate the null distribution by a wild bootstrap over blocks.

    residual (N,): residuals after subtraction of the best explanation. block (N,): label of each
    row; rows of one block share their random number. per_effect: divide the gain of each
    effect by its own inflation. Without motion capture it is not: the residuals contain errors of
    the estimated initial state that no draw contains, so the largest gain of any effect, undivided,
    is the threshold of all.
    """
    w = point.weight * point.noise.robust_weight(residual)
    _, index = np.unique(block, return_inverse=True)
    multipliers = _draw_multipliers(int(index.max()) + 1, seed)
    inflation = {}
    scores = []
    project = point.projection()
    for trial in trials:
        # 1. Projected direction d of the effect, and its squared length under independence.
        d = project(trial.residual.astype(np.float64) - point.residual)
        size = float((w * d) @ d)
        if size < MIN_SQUARED_CHANGE:
            continue
        # 2. Scores of the blocks; their sum of squares relative to that length is the inflation.
        sums = np.bincount(index, weights=w * d * residual)
        square = float(sums @ sums)
        inflation[trial.effect] = max(1.0, square / size) if per_effect else 1.0
        scores.append(sums / np.sqrt(max(square, 1e-300) if per_effect else size))
    # 3. Largest gain of any effect in each draw.
    best = np.max((multipliers @ np.stack(scores, axis=1))**2,
                  axis=1) if scores else np.zeros(NULL_DRAWS)
    return NullDistribution(inflation, np.sort(best))


def p_value(gain: float, null_gains: FloatArray) -> float:
    """Share of the null data sets with at least this gain; null_gains: ascending."""
    above = len(null_gains) - int(np.searchsorted(null_gains, gain, side="left"))
    return (1.0 + above) / (1.0 + len(null_gains))


def refit_p_value(point: Point, drop: float, block: IntArray, seed: int) -> float:
    """P-value of the loss reduction ``drop`` by a refit, if the parameters had been right.

    point: the result of the refit. block (N,): label of each row.
    """
    scores = point.block_gradients(block)
    sums = _draw_multipliers(len(scores), seed) @ scores
    drops = np.sum(sums * np.linalg.solve(point.normal, sums.T).T, axis=1)
    return p_value(drop, np.sort(drops))


def _draw_multipliers(blocks: int, seed: int) -> FloatArray:
    """Draw the normal multipliers, (NULL_DRAWS, blocks)."""
    return np.random.default_rng(seed).standard_normal((NULL_DRAWS, blocks))
