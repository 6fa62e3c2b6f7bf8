"""Pairs of effects that mask each other: both together explain what neither explains alone.

The effect with the largest gain alone can be a substitute for two others. For example, steering
play combined with a trim resembles a smaller steering gain. With d_a = r(with a) - r, P the
projection and Omega as in ``fit``, to second order

    gain(a, b) = max over l, m of - 2 g^T (l, m) - (l, m) C (l, m)^T,  g_a = d_a^T Omega r
                                                                       C_ab = d_a^T Omega P d_b
    a, b mask each other if  gain(a, b) - gain(a) > t_b,  gain(a, b) - gain(b) > t_a
                       and   gain(a, b) - gain(c) > max(t_a, t_b) for every c alone

l, m: factors on the two changes, 0 to ``max_step``; t: threshold of the gain of an effect. The
prediction is confirmed by a fit with both effects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray

from .fit import Point
from .scan import Trial

FitEffect = Callable[[Point, Trial], Point]
# Relative determinant of two changes below which they are treated as parallel: rounding errors.
MIN_RELATIVE_DETERMINANT = 1e-9


def find_masked_effect(point: Point, candidates: Sequence[Trial], trials: Sequence[Trial],
                       thresholds: Mapping[str, float], fits: dict[str, Point],
                       fit_effect: FitEffect, max_step: float) -> Trial | None:
    """Find an effect that must be accepted first because it and another effect mask each other.

    candidates: trials that may be accepted. thresholds: minimum gain by effect. fits: fits by
    effect; fits that are made here are added. Returns None if there is no such pair.
    """
    best = min((f.loss() for f in fits.values()), default=point.loss())
    for one, other in find_masking_pairs(point, trials, thresholds, max_step):
        if one not in candidates:
            continue
        near = fits[one.effect] = fits.get(one.effect) or fit_effect(point, one)
        # The second effect is added to the fit of the first, with the change that it made alone.
        change = other.residual.astype(np.float64) - point.residual
        both = fit_effect(near, replace(other, residual=near.residual + change))
        if best - both.loss() > max(thresholds[one.effect], thresholds[other.effect]):
            return one
    return None


def find_masking_pairs(point: Point, trials: Sequence[Trial], thresholds: Mapping[str, float],
                       max_step: float) -> list[tuple[Trial, Trial]]:
    """List the pairs that mask each other by the prediction, largest gain of both first.

    The first of a pair has the larger gain alone.
    """
    positive = [t for t in trials if t.gain > 0.0]
    if len(positive) < 2:
        return []
    change = np.stack([t.residual.astype(np.float64) - point.residual for t in positive], axis=1)
    weighted = change * point.irls_weight[:, None]
    alone, both = pair_gains(weighted.T @ point.residual, weighted.T @ point.projection()(change),
                        max_step)
    threshold = np.array([thresholds[t.effect] for t in positive])
    conditional_margin = both - alone[:, None] - threshold  # of the second, given the first
    margin_over_best = both - alone.max() - np.maximum(threshold, threshold[:, None])
    masking = np.triu(np.minimum(np.minimum(conditional_margin, conditional_margin.T),
                                 margin_over_best) > 0.0, 1)
    # Upper triangle: each pair once. Trials are sorted by their gain, so the row gains more.
    pairs = sorted(zip(*np.nonzero(masking), strict=True), key=lambda ij: -both[ij])
    return [(positive[i], positive[j]) for i, j in pairs]


def pair_gains(slope: FloatArray, normal: FloatArray, max_step: float) -> tuple[FloatArray,
                                                                                FloatArray]:
    """Gain of each effect alone (t,) and of each pair (t, t), from g (t,) and C (t, t).

    The factors are within [0, max_step]. At a corner of that square the result is a lower bound; it
    is never below the gain of one of the two.
    """
    size = np.maximum(np.diag(normal), MIN_RELATIVE_DETERMINANT)
    step = np.clip(-slope / size, 0.0, max_step)
    alone = -(2.0 * slope + size * step) * step
    g = slope[:, None]
    c = size[:, None]
    most = c * size
    # Unconstrained minimum of the first factor, clipped; then the second factor given the first.
    determinant = most - normal**2
    one = np.divide(normal * slope - size * g, determinant, out=np.zeros_like(normal),
                    where=determinant > MIN_RELATIVE_DETERMINANT * most)
    one = np.clip(one, 0.0, max_step)
    two = np.clip(-(slope + normal * one) / size, 0.0, max_step)
    both = -(2.0 * g + c * one + 2.0 * normal * two) * one - (2.0 * slope + size * two) * two
    both = np.maximum(both, both.T)
    return alone, np.maximum(both, np.maximum(alone, alone[:, None]))
