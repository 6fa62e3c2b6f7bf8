"""Which other effects explain the data as well, within what the data can tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dart_hal.types import FloatArray

from .fit import Point
from .noise import loss
from .rows import Rows
from .scan import Trial

MUCH = 0.5  # of the gain
CLEAR = 2.0  # standard deviations of the difference of losses
TOGETHER = 0.6
"""Cosine between what two effects do to the residuals: below, they explain different parts."""
SAME = 4.0  # loss: a difference of two standard deviations of one number


def directions(point: Point) -> Callable[[Trial], FloatArray]:
    """Where a trial moves the residuals once all that is free has followed, (N,) of length 1."""
    project, w = point.projection(), point.weights

    def direction(trial: Trial) -> FloatArray:
        d = project(trial.residual.astype(np.float64) - point.residual)
        return np.asarray(d * np.sqrt(w) / max(float(np.sqrt((w * d) @ d)), 1e-12))

    return direction


def together(point: Point, best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Those that explain much of what the best one does, itself among them."""
    direction = directions(point)
    along = direction(best)
    return [t for t in trials if t.effect == best.effect or (
        t.gain > MUCH * best.gain and abs(float(direction(t) @ along)) >= TOGETHER)]


def alike(point: Point, best: Trial, trials: Sequence[Trial], rows: Rows,
          fits: Mapping[str, Point]) -> tuple[str, ...]:
    """Effects whose loss differs from the best one's by less than its noise over blocks.

    fits: with some of the effects; of the others the linear answer counts.
    """
    def by_block(trial: Trial) -> FloatArray:
        fit = fits.get(trial.effect)
        r = point.after(trial.residual.astype(np.float64)) if fit is None else fit.residual
        return np.asarray(np.bincount(rows.block, weights=point.worth * loss(r)), dtype=float)

    mine = by_block(best)
    out = []
    for trial in together(point, best, trials):
        if trial.effect == best.effect:
            continue
        worse = by_block(trial) - mine
        total = float(worse.sum())
        noise = float(np.sqrt(np.sum((worse - worse.mean())**2)))
        if total < max(SAME, CLEAR * noise):
            out.append((total, trial.effect))
    return tuple(name for _, name in sorted(out))
