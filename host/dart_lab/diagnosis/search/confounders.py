"""Which other effects explain the data as well, within what the data can tell.

With D_b = J_b(other) - J_b(best) the difference of losses on block b, an effect whose projected
direction has a cosine of at least ``cosine`` with the best one's is a confounder if

    sum_b D_b < max(loss, clear sqrt(sum_b (D_b - mean D)^2))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dart_hal.core.types import FloatArray

from ..evidence.rows import RowLabels
from ..policy import ConfounderPolicy
from .fit import Point
from .scan import Trial


def directions(point: Point) -> Callable[[Trial], FloatArray]:
    """Where a trial moves the residuals once all that is free has followed, (N,) of length 1."""
    project, w = point.projection(), point.irls_weight

    def direction(trial: Trial) -> FloatArray:
        d = project(trial.residual.astype(np.float64) - point.residual)
        return np.asarray(d * np.sqrt(w) / max(float(np.sqrt((w * d) @ d)), 1e-12))

    return direction


def correlated(point: Point, best: Trial, trials: Sequence[Trial],
               policy: ConfounderPolicy) -> list[Trial]:
    """Those that explain much of what the best one does, itself among them."""
    direction = directions(point)
    along = direction(best)
    return [t for t in trials if t.effect == best.effect or (
        t.gain > policy.gain * best.gain and abs(float(direction(t) @ along)) >= policy.cosine)]


def confounders(point: Point, best: Trial, trials: Sequence[Trial], rows: RowLabels,
                fits: Mapping[str, Point], policy: ConfounderPolicy) -> tuple[str, ...]:
    """Effects that are not distinguished from the best one, the nearest first.

    fits: with some of the effects; of the others the linear answer counts.
    """
    def by_block(trial: Trial) -> FloatArray:
        fit = fits.get(trial.effect)
        r = point.after(trial.residual.astype(np.float64)) if fit is None else fit.residual
        return np.asarray(np.bincount(rows.block, point.weight * point.noise.loss(r)), dtype=float)

    mine = by_block(best)
    out = []
    for trial in correlated(point, best, trials, policy):
        if trial.effect == best.effect:
            continue
        worse = by_block(trial) - mine
        total = float(worse.sum())
        noise = float(np.sqrt(np.sum((worse - worse.mean())**2)))
        if total < max(policy.loss, policy.clear * noise):
            out.append((total, trial.effect))
    return tuple(name for _, name in sorted(out))
