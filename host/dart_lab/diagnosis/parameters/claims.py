"""Parameter findings: groups of parameters that were wrong, with old and new values and costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.objective import Point

from ..final_fit import FinalFit
from ..grade.constancy import assess_constancy
from ..grade.secants import Secants, find_coordinates, parameter_tangent
from ..policy import ClaimPolicy
from ..result import Claim, Cost, QuantityChange
from .cost import group_cost
from .groups import GROUPS, MERGED, Quantities, list_quantities
from .sets import GroupFits, GroupSet, Posterior, posterior
from .unseen import RecordingLosses

MIN_PAIR_DIFFERENCE = 0.05  # probability of a pair, minus that of each part: one finding for both
MIN_CONFOUNDER_PROBABILITY = 0.1  # of another group without the one that is found
PARAMETER_DRAWS = 200  # of the fitted parameters, for the standard error of a quantity


@dataclass(frozen=True, slots=True)
class ClaimInputs:
    """Input of ``find_claims``.

    groups: fits by set of free groups. losses: the test recordings, by the last fit. linear: that
    fit, with its units and features. final: the fit whose numbers are reported; logged: its vehicle
    with delays counted from the log.
    """

    groups: GroupFits
    losses: RecordingLosses
    linear: Secants
    final: FinalFit
    logged: Vehicle
    seed: int


def find_claims(inputs: ClaimInputs) -> tuple[Claim, ...]:
    """Find the groups of parameters that were wrong, the largest cost first.

    1. Compute the probability of each group; a pair of confounded groups counts as one.
    2. Keep those that were more probably wrong than right.
    3. Keep those without which the errors on the test recordings are larger, and whose parameters
       have left the standard errors that the file states.
    """
    groups = inputs.groups
    policy = groups.policy.claims
    confident = groups.policy.grade.confident_probability
    found = posterior(groups, inputs.seed)
    pairs = _pair_groups(found)
    paired = frozenset().union(*pairs)
    parts = {frozenset({g}): found.probability(g) for g in found.groups if g not in paired}
    parts |= {pair: found.probability(*pair) for pair in pairs}
    believed = {part: p for part, p in parts.items() if p > policy.min_probability}
    free = frozenset().union(*believed)
    if not free:
        return ()
    losses = cache(lambda some: inputs.losses.motion(groups.fit(some)))
    costs = {part: group_cost(losses, free, part) for part in believed}
    wrong = [part for part, p in believed.items()
             if _raises_errors(costs[part], p >= confident, policy)
             and _exceeds_stated_error(groups, part)]
    out = [_make_claim(inputs, part, believed[part], costs[part], found) for part in wrong]
    return tuple(sorted(out, key=lambda c: -c.cost[0]))


def _raises_errors(cost: Cost, confident: bool, policy: ClaimPolicy) -> bool:
    """Return whether errors on the test recordings are larger without the group.

    By their ratio for a confident group, by the lower end of its interval for others.
    """
    ratio, low, _ = cost
    by_ratio = confident or not math.isfinite(low)
    return (ratio if by_ratio else low) > policy.min_error_ratio


def _pair_groups(found: Posterior) -> list[GroupSet]:
    """Return pairs of groups of which one was wrong, and the data do not determine which."""
    def is_confounded(pair: GroupSet) -> bool:
        together = found.probability(*pair)
        return max(map(found.probability, pair)) < together - MIN_PAIR_DIFFERENCE

    return [pair for pair in MERGED if pair <= set(found.groups) and is_confounded(pair)]


def _exceeds_stated_error(groups: GroupFits, part: GroupSet) -> bool:
    """Return whether parameters have left the range stated in the file; True without a range.

    They have if one of the group moved by more than its stated errors allow (one without a stated
    error: by more than as many usual widths), or if those with stated errors have together left the
    ellipsoid of the same probability. The sum of a delay and a lag is known far better than each,
    so a change of both within their errors can be far outside of it:

        x^T R^-1 x > quantile of chi^2 with k degrees of freedom

    x (k,): changes in standard errors, R (k, k): correlations that the file states.
    """
    from scipy.special import chdtri, ndtr  # takes half a second: imported where used

    point = groups.full
    mine = [n for g in part for n in groups.names(g)]
    known = [n for n in mine if n in groups.known]
    if not known:
        return True
    stated = groups.policy.claims.max_stated_stds
    if any(abs(point.x[point.space.names.index(n)]) > stated for n in mine):
        return True
    x = np.array([point.x[point.space.names.index(n)] for n in known])
    distance = float(x @ np.linalg.solve(point.space.stated_correlation(known, groups.joint), x))
    return bool(distance > chdtri(len(known), 2.0 * ndtr(-stated)))


def _make_claim(inputs: ClaimInputs, part: GroupSet, probability: float, costs: Cost,
                found: Posterior) -> Claim:
    """Make the finding of a group, or of two confounded ones."""
    groups = inputs.groups
    policy = groups.policy
    names = tuple(n for g in sorted(part) for n in groups.names(g))
    known = [GROUPS[g] for g in sorted(part)]
    group, title = MERGED[part][:2] if part in MERGED else (next(iter(part)), known[0].title)
    quantities = list_quantities(group, groups.base)
    confounders = () if len(part) > 1 else tuple(
        g for g, p in found.probability_without(next(iter(part))).items()
        if p > MIN_CONFOUNDER_PROBABILITY)
    mine = find_coordinates(groups.full, names)
    tangent = parameter_tangent(groups.full, mine)
    linear = replace(inputs.linear, tangent={group: tangent}, coordinates={group: mine})
    changes, stds = find_changes(inputs, names, quantities)
    return Claim(group, title, names, probability, changes,
                 costs, confounders, " ".join(k.experiment for k in known),
                 assess_constancy(linear, group, policy.grade, inputs.seed), stds)


def find_changes(inputs: ClaimInputs, names: tuple[str, ...], quantities: Quantities
                 ) -> tuple[dict[str, QuantityChange], dict[str, float]]:
    """Return old and new value of each quantity with its error, and errors of the parameters.

    The stated errors of these parameters are contradicted, but draw the fit towards the stated
    values.

    1. Release the parameters from them, to first order.
    2. Draw parameters from the covariance without them: the spread of a quantity is its sampling
       error.
    3. Add in quadrature how far the quantity moves with the release.

    names: what those of the parameters begin with.
    """
    point = inputs.final.point
    base = inputs.groups.base
    mine = find_coordinates(point, names)
    rng = np.random.default_rng(inputs.seed)
    x, covariance = release_prior(point, inputs.final.covariance, mine,
                                  inputs.groups.policy.prior.max_stated_stds)
    draws = rng.multivariate_normal(point.x[list(mine)], covariance[np.ix_(mine, mine)],
                                    PARAMETER_DRAWS, method="eigh", check_valid="ignore")
    cars = [_vehicle_at(point, mine, drawn) for drawn in draws]
    released = _vehicle_at(point, mine, x[list(mine)])
    fitted = _vehicle_at(point, mine, point.x[list(mine)])
    out = {}
    for name, (unit, quantity) in quantities.items():
        values = np.array([quantity(car) for car in cars])
        error = math.hypot(float(np.std(values)), quantity(released) - quantity(fitted))
        out[name] = QuantityChange(quantity(base), quantity(inputs.logged), error, unit)
    moved = x - point.x
    stds = point.space.standard_errors(point.x, covariance + np.outer(moved, moved))
    return out, {point.space.names[i]: stds[point.space.names[i]] for i in mine}


def release_prior(point: Point, covariance: FloatArray, mine: Sequence[int], width: float
                  ) -> tuple[FloatArray, FloatArray]:
    """Return minimum (k,) and covariance (k, k) with a prior ``width`` times as wide.

    With the normal matrix N of the minimum x, the precision R of the prior that is removed, the
    data's part B of the scores, the remaining precision P, and C = N^-1 (B + P + R) N^-1:

        M  = N - R
        x' = M^-1 N x                      the gradient of what remains is -R x
        C' = M^-1 (N C N - R) M^-1 = M^-1 (B + P) M^-1
    """
    narrower = np.ones(len(point.x))
    narrower[list(mine)] = 1.0 / width
    prior = point.space.prior_precision
    removed = prior - prior * np.outer(narrower, narrower)
    normal = point.normal
    inverse = np.linalg.inv(normal - removed)
    scores = normal @ covariance @ normal - removed
    return inverse @ normal @ point.x, inverse @ scores @ inverse


def _vehicle_at(point: Point, mine: Sequence[int], x: FloatArray) -> Vehicle:
    """Return the vehicle of a point with other values of some coordinates."""
    whole = point.x.copy()
    whole[list(mine)] = x
    return point.space.split(np.clip(whole, point.space.low, point.space.high))[0]
