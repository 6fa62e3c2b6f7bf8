"""Confounders: other effects that explain the data equally well.

With D_b = J_b(other) - J_b(best), the difference of the losses on block b, another effect is a
confounder of the best one if

    gain(other) > MIN_GAIN_SHARE gain(best)
    cosine between the projected directions of both >= min_cosine
    sum_b D_b < max(MIN_LOSS_DIFFERENCE, min_difference_stds sqrt(sum_b (D_b - mean D)^2))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dart_hal.core.types import FloatArray
from dart_lab.identification.evidence.rows import RowLabels
from dart_lab.identification.objective import Point

from ..policy import ConfounderPolicy
from .scan import Trial

# Share of the gain of the best effect; another one with less is not compared with it.
MIN_GAIN_SHARE = 0.5
# A smaller difference of losses is not significant, even if it is steady.
MIN_LOSS_DIFFERENCE = 4.0


def direction_function(point: Point) -> Callable[[Trial], FloatArray]:
    """Return a function that computes the projected unit direction (N,) of a trial.

    The direction is the change of the residuals after the free parameters have been re-fitted to
    first order.
    """
    project = point.projection()
    w = point.irls_weight

    def direction(trial: Trial) -> FloatArray:
        d = project(trial.residual.astype(np.float64) - point.residual)
        return np.asarray(d * np.sqrt(w) / max(float(np.sqrt((w * d) @ d)), 1e-12))

    return direction


def select_correlated(point: Point, best: Trial, trials: Sequence[Trial],
                      policy: ConfounderPolicy) -> list[Trial]:
    """Select the trials that are correlated with the best trial, and the best trial itself."""
    direction = direction_function(point)
    best_direction = direction(best)
    return [t for t in trials if t.effect == best.effect or (
        t.gain > MIN_GAIN_SHARE * best.gain
        and abs(float(direction(t) @ best_direction)) >= policy.min_cosine)]


def find_confounders(point: Point, best: Trial, trials: Sequence[Trial], rows: RowLabels,
                     fits: Mapping[str, Point], policy: ConfounderPolicy) -> tuple[str, ...]:
    """List the effects that the data cannot distinguish from the best one, closest loss first.

    fits: by effect, a fit that includes it. For other effects the linearised fit is used.
    """
    # Loss of each block, from the fit if there is one, otherwise from the linearised fit.
    def block_losses(trial: Trial) -> FloatArray:
        fit = fits.get(trial.effect)
        r = fit.residual if fit is not None else point.residual_after_step(
            trial.residual.astype(np.float64))
        return np.asarray(np.bincount(rows.block, point.weight * point.noise.loss(r)), dtype=float)

    best_losses = block_losses(best)
    out = []
    for trial in select_correlated(point, best, trials, policy):
        if trial.effect == best.effect:
            continue
        difference = block_losses(trial) - best_losses
        # An effect is distinguishable if its loss is larger by more than the noise.
        total = float(difference.sum())
        noise = float(np.sqrt(np.sum((difference - difference.mean())**2)))
        if total < max(MIN_LOSS_DIFFERENCE, policy.min_difference_stds * noise):
            out.append((total, trial.effect))
    return tuple(name for _, name in sorted(out))
