"""How often nothing at all would have looked as good as an effect does.

Nothing at all has residuals without a side: turning the sign of whole blocks
of them gives as many data sets without a cause as one wants, with the same
disturbance and its memory. What counts is the best of all effects in each, so
a threshold holds for the family and not for one name.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dart_hal.types import FloatArray

from .fit import Point
from .noise import weight
from .scan import Trial

FLIPS = 1999


def best_of_nothing(point: Point, rest: FloatArray, trials: Sequence[Trial],
                    block: NDArray[np.int64], seed: int) -> FloatArray:
    """Largest gain of any trial in each of FLIPS data sets without a cause, ascending.

    rest (N,): residuals with the best explanation taken away, so that no cause
    is in them; block (N,): labels of what turns its sign together.
    """
    w = point.worth * weight(rest)
    _, index = np.unique(block, return_inverse=True)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(FLIPS, int(index.max()) + 1))
    scores, sizes = [], []
    project = point.projection()
    for trial in trials:
        d = project(trial.residual.astype(np.float64) - point.residual)
        sizes.append(max(float((w * d) @ d), 1e-12))
        scores.append(np.bincount(index, weights=w * d * rest))
    sums = signs @ np.stack(scores, axis=1)
    return np.sort(np.max(sums**2 / np.array(sizes), axis=1))


def p_value(gain: float, nothing: FloatArray) -> float:
    """Share of the data sets without a cause in which something gains as much."""
    above = len(nothing) - int(np.searchsorted(nothing, gain, side="left"))
    return (1.0 + above) / (1.0 + len(nothing))


def threshold(nothing: FloatArray, false_alarm: float) -> float:
    """Gain that only this share of the data sets without a cause reaches."""
    return float(np.quantile(nothing, 1.0 - false_alarm))


def refit_p_value(point: Point, drop: float, block: NDArray[np.int64], seed: int) -> float:
    """How often a refit of parameters that were right would lower the loss by ``drop``.

    point: where the refit ended; block: labels (N,) of its rows.
    """
    scores = point.scores(block)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(FLIPS, len(scores)))
    sums = signs @ scores
    drops = np.sum(sums * np.linalg.solve(point.normal, sums.T).T, axis=1)
    return p_value(drop, np.sort(drops))
