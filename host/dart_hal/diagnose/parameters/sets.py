"""Which groups were wrong: the posterior over the sets of groups that may have moved.

For a set S, every parameter outside of it stays where the model has it, effects and timing move:

    L_u(S) = sum_(i in u) w_i rho(r_i(x_S)),  x_S = argmin J over what is free     by unit u
    log p(S) = -sum_u c_u L_u(S) / 2 phi - 1/2 ln det H_S + |S| ln q + |not S| ln(1 - q) + const
    phi = max(1, tr(B^-1 sum_u s_u s_u^T) / k)      overdispersion of the scores of units
    P(g) = mean over draws c of sum_(S with g) p_c(S)

H_S: normal matrix of the parameters of S, in prior standard deviations, with what else moves
projected out: Laplace's evidence, so that a parameter which the data hardly tell costs nothing.
A command's age is free in every fit, so no delay is named for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dart_hal.types import FloatArray, IntArray
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.residuals import Evidence
from ..evidence.space import Space
from ..policy import Policy
from ..search.fit import Point, refit_near
from .groups import GROUPS

Set = frozenset[str]


@dataclass(frozen=True, slots=True)
class Sets:
    """Fits by set of free groups; the training evidence, the last fit, units (N,) of its rows."""

    evidence: Evidence
    base: Vehicle
    full: Point
    unit: IntArray
    known: Mapping[str, float]
    policy: Policy
    fits: dict[Set, Point]

    @property
    def free(self) -> tuple[str, ...]:
        """Base parameters that the last fit moved."""
        effects = {a.name for a in self.full.vehicle.effects}
        own = {a.name for a in self.base.effects}
        return tuple(n for n in self.full.space.names
                     if n.partition(".")[0] not in effects - own)

    def names(self, group: str) -> tuple[str, ...]:
        """Free parameters of a group."""
        return GROUPS[group].of(self.free)

    def coordinates(self, group: str) -> list[int]:
        """Of the last fit, those of a group."""
        return [self.full.space.names.index(n) for n in self.names(group)]

    def fit(self, free: Set) -> Point:
        """Fitted anew with some groups at the values of the model."""
        if free not in self.fits:
            p = self.full.vehicle
            names = tuple(n for n in self.free
                          if any(n in self.names(g) for g in free) or not _grouped(n))
            vehicle = _at_null(self.base, p)
            space = Space(vehicle, names, self.known, self.evidence.late, self.policy.prior)
            x = space.start(p, self.full.timing)
            self.fits[free] = refit_near(self.evidence, self.full.noise, space, x, self.full)
        return self.fits[free]

    def losses(self, free: Set) -> FloatArray:
        """(u,) loss of each unit."""
        point = self.fit(free)
        by_row = point.weight * point.noise.loss(point.residual)
        by_row = by_row + point.prior(np.zeros(len(point.x))) / len(by_row)
        return np.asarray(np.bincount(self.unit, by_row, int(self.unit.max()) + 1),
                          dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Posterior:
    """weight (sets,) of sets of groups; groups: those that may have moved, the surest first."""

    groups: tuple[str, ...]
    sets: tuple[Set, ...]
    weight: FloatArray

    def of(self, *groups: str) -> float:
        """P that any of them has left its old value."""
        return float(self.weight @ np.array([bool(s & set(groups)) for s in self.sets]))

    def instead(self, group: str) -> dict[str, float]:
        """P of each other group without this one."""
        return {g: float(self.weight @ np.array([g in s and group not in s for s in self.sets]))
                for g in self.groups if g != group}


def posterior(of: Sets, seed: int) -> Posterior:
    """Of the groups that may have moved; those that hardly did are left out.

    From the set that is best to second order, one group at a time leaves or enters as long as a
    fit with it says that this is better; what is nearly as good as the best set stays.
    """
    policy, phi = of.policy.claims, dispersion(of.full, of.unit)
    every = frozenset(g for g in GROUPS if of.names(g))
    guessed = _guessed(of, every, phi)
    prices: dict[Set, float] = {}

    def price(s: Set) -> float:
        if s not in prices:
            prices[s] = float(of.losses(s).sum()) / phi + _paid(of, s, phi)
        return prices[s]

    best, last = min(guessed, key=lambda s: guessed[s]), None
    while best != last:
        last = best
        swaps = [best - {a} | {b} for a in sorted(best) for b in sorted(every - best)]
        near = [*(best ^ {g} for g in sorted(every)),
                *(s for s in swaps if guessed[s] < guessed[best] + policy.swap)]
        best = min([best, *near], key=price)
    return _posterior(of, [s for s in prices if prices[s] < prices[best] + policy.certain], phi,
                      seed)


def _posterior(of: Sets, sets: Sequence[Set], phi: float, seed: int) -> Posterior:
    """With the groups that are not too improbable, the surest first."""
    weight = weights(of, sets, phi, seed)
    every = Posterior(tuple(sorted(frozenset().union(*sets))), tuple(sets), weight)
    seen = [g for g in every.groups if every.of(g) > of.policy.claims.hardly]
    return replace(every, groups=tuple(sorted(seen, key=lambda g: -every.of(g))))


def all_sets(of: Sets, seed: int) -> Posterior:
    """The same of all sets there are, each fitted: what the search is checked against."""
    every = sorted(g for g in GROUPS if of.names(g))
    sets = [frozenset(s) for k in range(len(every) + 1) for s in combinations(every, k)]
    return _posterior(of, sets, dispersion(of.full, of.unit), seed)


def _guessed(of: Sets, every: Set, phi: float) -> dict[Set, float]:
    """-2 log p of every set to second order around the fit with all groups.

    To hold coordinates x_out at 0 costs x_out^T [(H^-1)_out,out]^-1 x_out.
    """
    point, inverse = of.full, np.linalg.inv(of.full.normal)
    groups, prices = sorted(every), dict[Set, float]()
    for s in (frozenset(s) for k in range(len(groups) + 1) for s in combinations(groups, k)):
        out = [i for g in groups if g not in s for i in of.coordinates(g)]
        x = point.x[out]
        rise = float(x @ np.linalg.solve(inverse[np.ix_(out, out)], x)) if out else 0.0
        prices[s] = rise / phi + _paid(of, s, phi)
    return prices


def _paid(of: Sets, s: Set, phi: float) -> float:
    """What a set pays for being improbable, and for what its parameters could have been."""
    point, q = of.full, of.policy.claims.prior
    mine = [i for g in sorted(s) for i in of.coordinates(g)]
    grouped = {i for g in GROUPS for i in of.coordinates(g)}
    beside = [i for i in range(len(point.x)) if i not in grouped]
    pull = np.diag(point.space.pull + 1e-6)
    normal = (point.normal - pull) / phi + pull

    def log_det(some: Sequence[int]) -> float:
        return float(np.linalg.slogdet(normal[np.ix_(some, some)])[1]) if len(some) else 0.0

    return (log_det([*beside, *mine]) - log_det(beside)
            + 2.0 * len(s) * float(np.log((1.0 - q) / q)))


def weights(of: Sets, sets: Sequence[Set], phi: float, seed: int) -> FloatArray:
    """(sets,) posterior, mean over draws of units."""
    policy = of.policy.claims
    losses = np.stack([of.losses(s) for s in sets], axis=1)
    units = len(losses)
    counts = np.random.default_rng(seed).multinomial(
        units, np.full(units, 1.0 / units), size=policy.draws)
    paid = np.array([_paid(of, s, phi) for s in sets])
    log = -counts @ losses / (2.0 * phi) - 0.5 * paid
    p = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray((p / p.sum(axis=1, keepdims=True)).mean(axis=0))


def dispersion(point: Point, unit: IntArray) -> float:
    """How much more the scores of units differ than independent residuals would make them."""
    scores = point.scores(unit)
    scores = scores - scores.mean(axis=0)
    n = len(scores)
    spread = np.trace(np.linalg.solve(point.normal, scores.T @ scores)) / len(point.x)
    return max(1.0, float(spread) * n / max(n - 1, 1))


def _grouped(name: str) -> bool:
    return any(name.startswith(g.names) for g in GROUPS.values())


def _at_null(base: Vehicle, p: Vehicle) -> Vehicle:
    """The base with the effects of another vehicle at their null."""
    for a in p.effects:
        if a.name not in {b.name for b in base.effects}:
            base = apply(base, a.name)
    return base
