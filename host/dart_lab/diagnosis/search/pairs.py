"""Two causes that hide each other: together they explain what neither does alone.

Whoever takes what gains most by itself may take an impostor of both. Play in the steering and a
trim beside it are, one at a time, worth no more than wheels that turn less far. With
d_a = r(with a) - r, P the projection and Omega as in ``fit``, to second order

    gain(a, b) = max over l, m of - 2 g^T (l, m) - (l, m) C (l, m)^T,  g_a = d_a^T Omega r
                                                                       C_ab = d_a^T Omega P d_b
    a, b hide each other if  gain(a, b) - gain(a) > limit_b,  gain(a, b) - gain(b) > limit_a
                        and  gain(a, b) - gain(c) > max(limit_a, limit_b) for every c alone

l, m: how much more of each than alone, 0 to ``furthest``; limit: what an effect must gain to be no
chance. A fit with both has to keep that promise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray

from .fit import Point
from .scan import Trial

FitWith = Callable[[Point, Trial], Point]
ROUNDING = 1e-9  # share of its largest: a determinant of two that do the same


def one_of_a_pair(point: Point, first: Sequence[Trial], trials: Sequence[Trial],
                  limits: Mapping[str, float], fits: dict[str, Point], fit_with: FitWith,
                  furthest: float) -> Trial | None:
    """What goes before others that gain more alone, for it and another one hide each other.

    first: what may be named; limits: by effect. fits: of effects alone, gets what is fitted here.
    """
    best = min((f.loss() for f in fits.values()), default=point.loss())
    for one, other in hidden_pairs(point, trials, limits, furthest):
        if one not in first:
            continue
        near = fits[one.effect] = fits.get(one.effect) or fit_with(point, one)
        change = other.residual.astype(np.float64) - point.residual
        both = fit_with(near, replace(other, residual=near.residual + change))
        if best - both.loss() > max(limits[one.effect], limits[other.effect]):
            return one
    return None


def hidden_pairs(point: Point, trials: Sequence[Trial], limits: Mapping[str, float],
                 furthest: float) -> list[tuple[Trial, Trial]]:
    """Those that promise to hide each other, what gains most together first; of each pair the one
    first that gains more alone."""
    some = [t for t in trials if t.gain > 0.0]  # the others have no size
    if len(some) < 2:
        return []
    change = np.stack([t.residual.astype(np.float64) - point.residual for t in some], axis=1)
    weighted = change * point.irls_weight[:, None]
    alone, both = gains(weighted.T @ point.residual, weighted.T @ point.projection()(change),
                        furthest)
    limit = np.array([limits[t.effect] for t in some])
    needed = both - alone[:, None] - limit  # the second beside the first
    beyond = both - alone.max() - np.maximum(limit, limit[:, None])
    hide = np.triu(np.minimum(np.minimum(needed, needed.T), beyond) > 0.0, 1)
    pairs = sorted(zip(*np.nonzero(hide), strict=True), key=lambda ij: -both[ij])
    return [(some[i], some[j]) for i, j in pairs]


def gains(slope: FloatArray, normal: FloatArray, furthest: float) -> tuple[FloatArray, FloatArray]:
    """(alone (t,), two together (t, t)) by g (t,) and C (t, t), steps within [0, furthest].

    At a corner of that square two may gain a little more; never less than one of them.
    """
    size = np.maximum(np.diag(normal), ROUNDING)
    step = np.clip(-slope / size, 0.0, furthest)
    alone = -(2.0 * slope + size * step) * step
    g, c = slope[:, None], size[:, None]
    most = c * size
    determinant = most - normal**2
    one = np.divide(normal * slope - size * g, determinant, out=np.zeros_like(normal),
                    where=determinant > ROUNDING * most)
    one = np.clip(one, 0.0, furthest)
    two = np.clip(-(slope + normal * one) / size, 0.0, furthest)
    both = -(2.0 * g + c * one + 2.0 * normal * two) * one - (2.0 * slope + size * two) * two
    both = np.maximum(both, both.T)
    return alone, np.maximum(both, np.maximum(alone, alone[:, None]))
