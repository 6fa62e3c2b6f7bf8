"""The null distribution: what the best effect would gain if nothing were missing.

Wild bootstrap (Wu 1986; Mammen 1993): each block b of the residuals q, from which the best
explanation has been taken, is multiplied by a normal number n_b. That keeps the disturbance
and its memory and removes any cause. For effect a with projected direction d = P (r_a - r):

    s_ab = sum_(i in b) w_i omega_i d_i q_i                score of a block
    f_a  = max(1, sum_b s_ab^2 / sum_i w_i omega_i d_i^2)  inflation over independent values
    T_a  = (sum_b n_b s_ab)^2 / sum_b s_ab^2               gain over inflation, one draw of n
    Q    = quantile 1 - alpha of max_a T_a                 one threshold for the whole family
    named only if gain(a) > f_a max(Q, Phi^-1(1 - alpha / 2m)^2),  m effects

Signs instead of normal numbers would have too few combinations on few blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from dart_hal.core.types import FloatArray, IntArray

from .fit import Point
from .scan import Trial

FAINT = 1e-6  # square of a change of the residuals: what changes nothing has rounding errors


@dataclass(frozen=True, slots=True)
class Nothing:
    """What effects gain where nothing is missing.

    inflation: by effect, how much more it gains there than independent residuals
    would give it; best (draws,): the largest gain of any effect over its
    inflation, in each data set without a cause, ascending.
    """

    inflation: Mapping[str, float]
    best: FloatArray

    def p_value(self, effect: str, gain: float) -> float:
        """Share of the data sets without a cause in which something gains as much."""
        return p_value(gain / self.inflation.get(effect, 1.0), self.best)

    def needed(self, effects: Sequence[str], false_alarm: float) -> dict[str, float]:
        """By effect, the gain that only this share of the data sets without a cause exceeds.

        Never less than independent numbers give for as many effects: what is left may
        be no noise.
        """
        share = false_alarm / max(len(self.inflation), 1)
        independent = NormalDist().inv_cdf(1.0 - 0.5 * share)**2  # of chi square, one number
        limit = max(float(np.quantile(self.best, 1.0 - false_alarm)), independent)
        return {name: self.inflation.get(name, 1.0) * limit for name in effects}


def nothing_missing(point: Point, rest: FloatArray, trials: Sequence[Trial],
                    block: IntArray, seed: int, draws: int, apart: bool = True
                    ) -> Nothing:
    """From residuals in blocks.

    apart: each effect by its own inflation; else all by the largest gain of any,
    where residuals have errors of the method in them that no draw shows.
    rest (N,): residuals with the best explanation taken away, so that no cause
    is in them; block (N,): labels of what has one random number.
    """
    w = point.weight * point.noise.robust_weight(rest)
    _, index = np.unique(block, return_inverse=True)
    numbers = _numbers(int(index.max()) + 1, seed, draws)
    inflation, scores = {}, []
    project = point.projection()
    for trial in trials:
        d = project(trial.residual.astype(np.float64) - point.residual)
        size = float((w * d) @ d)
        if size < FAINT:
            continue
        sums = np.bincount(index, weights=w * d * rest)
        square = float(sums @ sums)
        inflation[trial.effect] = max(1.0, square / size) if apart else 1.0
        scores.append(sums / np.sqrt(max(square, 1e-300) if apart else size))
    best = np.max((numbers @ np.stack(scores, axis=1))**2, axis=1) if scores else np.zeros(draws)
    return Nothing(inflation, np.sort(best))


def p_value(gain: float, nothing: FloatArray) -> float:
    """Share of the data sets without a cause in which something gains as much."""
    above = len(nothing) - int(np.searchsorted(nothing, gain, side="left"))
    return (1.0 + above) / (1.0 + len(nothing))


def refit_p_value(point: Point, drop: float, block: IntArray, seed: int, draws: int
                  ) -> float:
    """How often a refit of parameters that were right would lower the loss by ``drop``.

    point: where the refit ended; block: labels (N,) of its rows.
    """
    scores = point.scores(block)
    sums = _numbers(len(scores), seed, draws) @ scores
    drops = np.sum(sums * np.linalg.solve(point.normal, sums.T).T, axis=1)
    return p_value(drop, np.sort(drops))


def _numbers(blocks: int, seed: int, draws: int) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((draws, blocks))
