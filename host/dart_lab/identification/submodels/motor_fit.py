"""Motor and throttle timing from driven stretches, the friction given; one fit of all sessions.

d, e and g trade places along a narrow valley, and where it lies changes with
the battery and the trim of the ESC. So d, e and the timing are common to all
sessions, each session has a dead band g of its own, and what is given back is
the mean session: it lies on the valley, as the mean of fits made apart does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.fitting.covariance import (
    collinearity,
    enclosing_covariance,
    leverage_covariance,
    scaled_inverse,
    split_into_blocks,
)
from dart_hal.vehicle.fitting.free_starts import fit_free_starts, sensitivity
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.fitting.robust import scatter
from dart_lab.identification.submodels.coasting import FRICTION
from dart_lab.identification.submodels.speeds import BLOCK, Speeds
from dart_lab.identification.submodels.straight import NAMES, Straight, first_speeds, problem_of
from dart_lab.identification.submodels.stretches import Stretches, cut

HUBER = 1.345  # sigmas; 95 % of the efficiency of the mean for normal errors (Huber 1964)
ROUNDS = 30  # of reweighting, far more than it takes
MIN_SESSIONS = 3  # of fewer, leaving one out tells little


@dataclass(frozen=True, slots=True)
class Bands:
    """Dead bands g (G,) of the sessions with their own std (G,), d and e taken as exact.

    variance_between: between sessions beyond that; share (G,) of each in the
    mean; variance: what the differences between sessions add to that of the mean.
    """

    g: FloatArray
    std: FloatArray
    variance_between: float
    share: FloatArray
    variance: float


def fit_motor(series: Sequence[Speeds], session: IntArray, base: Vehicle, x0: FloatArray,
              free: Sequence[str], friction: FloatArray, mass: float
              ) -> tuple[Straight, Bands | None]:
    """(fit of the ``free`` motor and timing, dead bands by session; None: g held).

    series with the session (len(series),) 0..G-1 of each; x0 (8,): the start,
    with the friction to take as given, whose covariance (3, 3) goes on into the
    fit's, with the cross terms; mass [kg].
    """
    s = cut(series)
    shared = [n for n in free if n != "g"]
    rows, k = [NAMES.index(n) for n in shared], len(shared)
    group = session[s.series] if "g" in free else None
    count = 0 if group is None else int(group.max()) + 1
    start = np.concatenate([x0[rows], np.full(count, x0[NAMES.index("g")])])
    solution, starts = fit_free_starts(problem_of(series, s, base, x0, shared, mass, group), start,
                             first_speeds(s))
    bands = _bands(solution, k, s) if count else None
    mean = np.eye(k) if bands is None else np.block(
        [[np.eye(k), np.zeros((k, count))], [np.zeros((1, k)), bands.share[None]]])
    inner = leverage_covariance(solution, s.block)
    if count > 1:  # the recording of a session with one recording has no error of its own
        inner = enclosing_covariance(inner, leverage_covariance(solution, _fine(s)))
    own = mean @ inner @ mean.T
    if bands is not None and group is not None:
        own[k, k] += bands.variance
        if count >= MIN_SESSIONS:
            own = enclosing_covariance(own, _left_out(solution, k, bands, group[s.stretch]))
    names = [n for n in (*shared, "g") if n in free]
    x = x0.copy()
    x[[NAMES.index(n) for n in names]] = mean @ solution.x
    held = problem_of(series, s, base, x, FRICTION, mass, group)
    slopes = sensitivity(held, np.concatenate([x[:3], solution.x[k:]]), starts, solution.weight)
    moved = mean @ _response(solution, slopes[:, :3])
    return _straight(solution, x, names, own, moved, friction, k), bands


def _response(solution: Solution, by: FloatArray) -> FloatArray:
    """Move (k, j) of the parameters when the residuals change by ``by`` (n, j)."""
    weighted = solution.jacobian * solution.weight[:, None]
    return np.asarray(-scaled_inverse(weighted.T @ solution.jacobian) @ (weighted.T @ by))


def _bands(solution: Solution, k: int, s: Stretches) -> Bands:
    """Mean of the dead bands, by their errors with d and e as found and by what is between.

    A session far from the others (another trim) counts less (Huber's weights,
    the spread from the median of the distances).
    """
    alone = replace(solution, jacobian=solution.jacobian[:, k:])
    std = np.sqrt(np.diag(leverage_covariance(alone, _fine(s))))
    g = solution.x[k:]
    usable = np.isfinite(std) & ~solution.at_bound[k:]
    usable |= not usable.any()
    own = np.where(np.isfinite(std), std, 1.0) ** 2
    mean, between, weight = float(np.median(g[usable])), 0.0, usable / own
    for _ in range(ROUNDS if usable.sum() > 1 else 0):
        off = np.abs(g - mean)
        between = max(scatter(off[usable]) ** 2
                      - float(np.median(own[usable])), 0.0)
        wide = np.sqrt(own + between)
        weight = usable * np.minimum(1.0, HUBER * wide / np.maximum(off, 1e-12)) / wide**2
        mean = float(weight @ g / weight.sum())
    share = weight / weight.sum()
    spread = np.where(share < 1.0, share * (g - mean) / np.maximum(1.0 - share, 0.1), 0.0)
    return Bands(g, std, between, share, max(float(spread @ spread - share**2 @ own), 0.0))


def _fine(s: Stretches) -> IntArray:
    """Blocks (n,) of some seconds, also where there are many recordings."""
    return split_into_blocks(s.t, s.series[s.stretch], BLOCK)


def _left_out(solution: Solution, k: int, bands: Bands, session: IntArray) -> FloatArray:
    """Covariance (k + 1, k + 1) by what leaving whole sessions out would change."""
    common, own = solution.jacobian[:, :k], solution.jacobian[:, k:]
    weighted = own * solution.weight[:, None]
    slope = -(weighted.T @ common) / np.maximum(np.sum(weighted * own, axis=0), 1e-300)[:, None]
    inner = replace(solution, x=solution.x[:k], jacobian=common + own @ slope)
    follow = np.concatenate([np.eye(k), (bands.share @ slope)[None]])
    out = follow @ leverage_covariance(inner, session) @ follow.T
    known = np.where(np.isfinite(bands.std), bands.std, 0.0)
    out[k, k] += float(bands.share**2 @ known**2) + bands.variance
    return np.asarray(out)


def _straight(solution: Solution, x: FloatArray, names: Sequence[str], own: FloatArray,
              moved: FloatArray, friction: FloatArray, k: int) -> Straight:
    """The fit in the order of NAMES, with the friction's covariance and the cross terms."""
    rows = [NAMES.index(n) for n in names]
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[:3, :3] = friction
    covariance[np.ix_(rows, rows)] = own + moved @ friction @ moved.T
    covariance[np.ix_(rows, [0, 1, 2])] = moved @ friction
    covariance[np.ix_([0, 1, 2], rows)] = friction @ moved.T
    jacobian = solution.jacobian
    if "g" in names:
        jacobian = np.column_stack([jacobian[:, :k], jacobian[:, k:].sum(axis=1)])
    independent = np.ones(len(NAMES))
    independent[rows] = collinearity(replace(solution, x=x[rows], jacobian=jacobian))
    stopped = [n for n, edge in zip(names, solution.at_bound, strict=False) if edge and n != "g"]
    if "g" in names and solution.at_bound[k:].all():
        stopped.append("g")
    return Straight(tuple(names), x, covariance, independent, solution.residual,
                    solution.converged, tuple(stopped))


def band_notes(names: Sequence[str], bands: Bands) -> list[str]:
    """The dead bands of the sessions, where there are several."""
    if len(names) < 2:
        return []
    out = [f"one fit of {len(names)} sessions, each with a dead band of its own; g is their mean, "
           f"standard deviation between them {np.sqrt(bands.variance_between):.3g}"]
    return [*out, *(f"{n}: g {g:.4f} +- {std:.2g}" for n, g, std in
                    zip(names, bands.g, bands.std, strict=True))]
