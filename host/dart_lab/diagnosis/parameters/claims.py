"""The claims: groups of parameters that were wrong, with old and new values and what each costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle

from ..final_fit import FinalFit
from ..grade.constancy import constancy
from ..grade.secants import Secants, starting, towards_null
from ..policy import ClaimPolicy
from ..result import Change, Claim, Cost
from ..search.fit import Point
from .cost import cost
from .groups import GROUPS, MERGED, Quantity
from .sets import Posterior, Set, Sets, posterior
from .unseen import Unseen

SAMPLES = 200  # of the fitted parameters, for the standard error of a quantity


@dataclass(frozen=True, slots=True)
class Asked:
    """What claims are made from. unseen: the test recordings, by the last fit; secants: of that
    fit, with its units and features.

    final: the fit whose numbers are reported; logged: its vehicle with delays counted from the log.
    """

    sets: Sets
    unseen: Unseen
    secants: Secants
    final: FinalFit
    logged: Vehicle
    seed: int


def claims(asked: Asked) -> tuple[Claim, ...]:
    """Those with the largest cost first; none where nothing is surely wrong."""
    of, policy = asked.sets, asked.sets.policy.claims
    found = posterior(of, asked.seed)
    together = _together(found, policy.unsure)
    paired = frozenset().union(*together)
    parts = {frozenset({g}): found.of(g) for g in found.groups if g not in paired}
    parts |= {pair: found.of(*pair) for pair in together}
    believed = {part: p for part, p in parts.items() if p > policy.believed}
    every = frozenset().union(*believed)
    if not every:
        return ()
    losses = cache(lambda free: asked.unseen.motion(of.fit(free)))
    costs = {part: cost(losses, every, part) for part in believed}
    held = [part for part, p in believed.items() if _costly(costs[part], p, policy)
            and _beyond_what_is_stated(of, part)]
    out = [_claim(asked, part, believed[part], costs[part], found) for part in held]
    return tuple(sorted(out, key=lambda c: -c.cost[0]))


def _costly(cost: Cost, probability: float, policy: ClaimPolicy) -> bool:
    """Whether errors on unseen recordings are larger without the group; surely so, where the
    group itself is not sure."""
    ratio, low, _ = cost
    by_ratio = probability >= policy.sure or not math.isfinite(low)
    return (ratio if by_ratio else low) > policy.worth


def _together(found: Posterior, by: float) -> list[Set]:
    """Pairs of groups of which the data say that one was wrong, and not which."""
    def unsure(pair: Set) -> bool:
        return max(found.of(g) for g in pair) < found.of(*pair) - by

    return [pair for pair in MERGED if pair <= set(found.groups) and unsure(pair)]


def _beyond_what_is_stated(of: Sets, part: Set) -> bool:
    """Whether a parameter has left what the file says it may be; True where it says nothing."""
    point = of.full
    mine = [n for g in part for n in of.names(g)]
    if not any(n in of.known for n in mine):
        return True
    return any(abs(point.x[point.space.names.index(n)]) > of.policy.claims.stated for n in mine)


def _claim(asked: Asked, part: Set, probability: float, costs: Cost,
           found: Posterior) -> Claim:
    of, policy = asked.sets, asked.sets.policy
    names = tuple(n for g in sorted(part) for n in of.names(g))
    known = [GROUPS[g] for g in sorted(part)]
    group, title, quantities = MERGED.get(part) or (
        next(iter(part)), known[0].title, known[0].quantities)
    like = () if len(part) > 1 else tuple(
        g for g, p in found.instead(next(iter(part))).items() if p > policy.claims.instead)
    mine = starting(of.full, names)
    tangent = towards_null(of.full, mine)
    secants = replace(asked.secants, tangent={group: tangent}, coordinates={group: mine})
    return Claim(group, title, names, probability, changes(asked, names, quantities), costs,
                 like, " ".join(k.experiment for k in known),
                 constancy(secants, group, policy.grade, asked.seed))


def changes(asked: Asked, names: tuple[str, ...], quantities: Mapping[str, tuple[str, Quantity]]
            ) -> dict[str, Change]:
    """By quantity, old and new value; its standard error from draws of the parameters.

    names: what those of the parameters begin with.
    """
    point, base = asked.final.point, asked.sets.base
    mine = starting(point, names)
    rng = np.random.default_rng(asked.seed)
    block = asked.final.covariance[np.ix_(mine, mine)]
    draws = rng.multivariate_normal(point.x[list(mine)], block, SAMPLES, method="eigh")
    cars = [_at(point, mine, x) for x in draws]
    out = {}
    for name, (unit, quantity) in quantities.items():
        spread = np.array([quantity(car) for car in cars])
        out[name] = Change(quantity(base), quantity(asked.logged), float(np.std(spread)), unit)
    return out


def _at(point: Point, mine: Sequence[int], x: FloatArray) -> Vehicle:
    whole = point.x.copy()
    whole[list(mine)] = x
    return point.space.split(np.clip(whole, point.space.low, point.space.high))[0]
