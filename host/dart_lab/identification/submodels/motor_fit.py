"""Motor and throttle timing from driven stretches with a given friction, all sessions together.

d, e and g are confounded along a narrow valley of the loss, whose place depends on the battery
and the trim of the ESC. The mean of separate fits would not be on the valley. So:

1. Fit d, e and the timing common to all sessions, and one dead band g for each session.
2. Average the dead bands: the result is the mean session, which is on the valley.
3. Covariance: over blocks, over sessions left out one at a time, and by the spread of g.
4. Propagate the covariance of what was fixed, the friction f: dx/df = -(J' W J)^-1 J' W dr/df. A
   dead band g that is not fitted is as uncertain as those of other cars.
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
from dart_lab.identification.submodels.coasting import FRICTION_NAMES
from dart_lab.identification.submodels.speeds import BLOCK_LENGTH, Speeds
from dart_lab.identification.submodels.straight import (
    STRAIGHT_NAMES,
    StraightFit,
    first_speeds,
    make_problem,
)
from dart_lab.identification.submodels.stretches import Stretches, cut_stretches

# 95 % of the efficiency of the mean for normal errors (Huber 1964).
HUBER_STDS = 1.345
# Far more than convergence takes.
MAX_REWEIGHTINGS = 30
# [throttle] Standard error of a dead band that is the base's.
UNKNOWN_DEAD_BAND_STD = 0.05
# Leaving one of fewer sessions out has little information.
MIN_SESSIONS = 3


@dataclass(frozen=True, slots=True)
class DeadBands:
    """Dead bands g (G,) of the sessions, with standard errors std (G,) for exact d and e.

    variance_between: excess variance between sessions; share (G,): weight of each in the mean;
    variance: contribution of the differences between sessions to the variance of the mean.
    """

    g: FloatArray
    std: FloatArray
    variance_between: float
    share: FloatArray
    variance: float


def fit_motor(series: Sequence[Speeds], session: IntArray, base: Vehicle, x0: FloatArray,
              free: Sequence[str], friction: FloatArray, mass: float
              ) -> tuple[StraightFit, DeadBands | None]:
    """Fit the ``free`` parameters; return (fit, dead bands by session, None if g is fixed).

    session (len(series),): 0..G-1 of each series; x0 (8,): start, with the given friction;
    friction (3, 3): its covariance, which enters the fit's with the cross terms; mass [kg].
    """
    s = cut_stretches(series)
    shared = [n for n in free if n != "g"]
    rows = [STRAIGHT_NAMES.index(n) for n in shared]
    k = len(shared)
    group = session[s.series] if "g" in free else None
    count = 0 if group is None else int(group.max()) + 1
    start = np.concatenate([x0[rows], np.full(count, x0[STRAIGHT_NAMES.index("g")])])
    solution, starts = fit_free_starts(make_problem(series, s, base, x0, shared, mass, group),
                                       start, first_speeds(s))
    # ``mean`` maps (shared, g of each session) to (shared, mean g).
    bands = _average_bands(solution, k, s) if count else None
    mean = np.eye(k) if bands is None else np.block(
        [[np.eye(k), np.zeros((k, count))], [np.zeros((1, k)), bands.share[None]]])
    inner = leverage_covariance(solution, s.block)
    if count > 1:
        # A session with one recording fits its own g to it: blocks of recordings show no error.
        inner = enclosing_covariance(inner, leverage_covariance(solution, _time_blocks(s)))
    own = mean @ inner @ mean.T
    if bands is not None and group is not None:
        own[k, k] += bands.variance
        if count >= MIN_SESSIONS:
            own = enclosing_covariance(own,
                                       _jackknife_covariance(solution, k, bands, group[s.stretch]))
    names = [n for n in (*shared, "g") if n in free]
    x = x0.copy()
    x[[STRAIGHT_NAMES.index(n) for n in names]] = mean @ solution.x
    # Response of the fit to what was fixed.
    fixed = FRICTION_NAMES if "g" in free else (*FRICTION_NAMES, "g")
    fixed_rows = [STRAIGHT_NAMES.index(n) for n in fixed]
    fixed_covariance = np.diag([0.0] * 3 + [UNKNOWN_DEAD_BAND_STD**2] * (len(fixed) - 3))
    fixed_covariance[:3, :3] = friction
    in_fixed = make_problem(series, s, base, x, fixed, mass, group)
    slopes = sensitivity(in_fixed, np.concatenate([x[fixed_rows], solution.x[k:]]), starts,
                         solution.weight)
    response = mean @ _response(solution, slopes[:, :len(fixed)])
    covariance = _join_covariances(names, own, fixed, fixed_covariance, response)
    return _make_fit(solution, x, names, covariance, k), bands


def _response(solution: Solution, change: FloatArray) -> FloatArray:
    """Return the shift (k, j) of the parameters if the residuals change by ``change`` (n, j)."""
    weighted = solution.jacobian * solution.weight[:, None]
    return np.asarray(-scaled_inverse(weighted.T @ solution.jacobian) @ (weighted.T @ change))


def _average_bands(solution: Solution, k: int, s: Stretches) -> DeadBands:
    """Average the dead bands by their errors and the variance between sessions.

    A session far from the others (another trim) counts less: Huber's weights, with the variance
    between sessions from the median of the distances.
    """
    alone = replace(solution, jacobian=solution.jacobian[:, k:])
    std = np.sqrt(np.diag(leverage_covariance(alone, _time_blocks(s))))
    g = solution.x[k:]
    usable = np.isfinite(std) & ~solution.at_bound[k:]
    usable |= not usable.any()
    own = np.where(np.isfinite(std), std, 1.0) ** 2
    mean = float(np.median(g[usable]))
    between = 0.0
    weight = usable / own
    for _ in range(MAX_REWEIGHTINGS if usable.sum() > 1 else 0):
        off = np.abs(g - mean)
        between = max(scatter(off[usable]) ** 2 - float(np.median(own[usable])), 0.0)
        wide = np.sqrt(own + between)
        weight = usable * np.minimum(1.0, HUBER_STDS * wide / np.maximum(off, 1e-12)) / wide**2
        mean = float(weight @ g / weight.sum())
    # Variance of the mean by leaving each session out, less what the errors of g explain.
    share = weight / weight.sum()
    spread = np.where(share < 1.0, share * (g - mean) / np.maximum(1.0 - share, 0.1), 0.0)
    return DeadBands(g, std, between, share, max(float(spread @ spread - share**2 @ own), 0.0))


def _time_blocks(s: Stretches) -> IntArray:
    """Return blocks (n,) of some seconds, however many recordings there are."""
    return split_into_blocks(s.t, s.series[s.stretch], BLOCK_LENGTH)


def _jackknife_covariance(solution: Solution, k: int, bands: DeadBands,
                          session: IntArray) -> FloatArray:
    """Covariance (k + 1, k + 1) from leaving whole sessions out.

    Each g is eliminated: it follows the shared parameters by ``slope`` (G, k).
    """
    common = solution.jacobian[:, :k]
    own = solution.jacobian[:, k:]
    weighted = own * solution.weight[:, None]
    slope = -(weighted.T @ common) / np.maximum(np.sum(weighted * own, axis=0), 1e-300)[:, None]
    inner = replace(solution, x=solution.x[:k], jacobian=common + own @ slope)
    expand = np.concatenate([np.eye(k), (bands.share @ slope)[None]])
    out = expand @ leverage_covariance(inner, session) @ expand.T
    known = np.where(np.isfinite(bands.std), bands.std, 0.0)
    out[k, k] += float(bands.share**2 @ known**2) + bands.variance
    return np.asarray(out)


def _join_covariances(names: Sequence[str], own: FloatArray, fixed: Sequence[str],
                      fixed_covariance: FloatArray, response: FloatArray) -> FloatArray:
    """Return the covariance (8, 8) in the order of STRAIGHT_NAMES.

    own (k, k): of the fitted ``names`` for exact ``fixed`` parameters, whose covariance is (f, f);
    response (k, f): of the fitted to the fixed.
    """
    rows = [STRAIGHT_NAMES.index(n) for n in names]
    fixed_rows = [STRAIGHT_NAMES.index(n) for n in fixed]
    out = np.zeros((len(STRAIGHT_NAMES), len(STRAIGHT_NAMES)))
    out[np.ix_(fixed_rows, fixed_rows)] = fixed_covariance
    out[np.ix_(rows, rows)] = own + response @ fixed_covariance @ response.T
    out[np.ix_(rows, fixed_rows)] = response @ fixed_covariance
    out[np.ix_(fixed_rows, rows)] = fixed_covariance @ response.T
    return out


def _make_fit(solution: Solution, x: FloatArray, names: Sequence[str], covariance: FloatArray,
              k: int) -> StraightFit:
    """Return the fit in the order of STRAIGHT_NAMES."""
    rows = [STRAIGHT_NAMES.index(n) for n in names]
    jacobian = solution.jacobian
    if "g" in names:
        jacobian = np.column_stack([jacobian[:, :k], jacobian[:, k:].sum(axis=1)])
    independent = np.ones(len(STRAIGHT_NAMES))
    independent[rows] = collinearity(replace(solution, x=x[rows], jacobian=jacobian))
    stopped = [n for n, edge in zip(names, solution.at_bound, strict=False) if edge and n != "g"]
    if "g" in names and solution.at_bound[k:].all():
        stopped.append("g")
    return StraightFit(tuple(names), x, covariance, independent, solution.residual,
                       solution.converged, tuple(stopped))


def band_notes(names: Sequence[str], bands: DeadBands) -> list[str]:
    """List the dead bands of the sessions, if there are several."""
    if len(names) < 2:
        return []
    out = [f"one fit of {len(names)} sessions, each with a dead band of its own; g is their mean, "
           f"standard deviation between them {np.sqrt(bands.variance_between):.3g}"]
    return [*out, *(f"{n}: g {g:.4f} +- {std:.2g}" for n, g, std in
                    zip(names, bands.g, bands.std, strict=True))]
