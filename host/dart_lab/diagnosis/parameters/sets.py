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

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.effects import with_nulls
from dart_hal.vehicle.fitting.levenberg_marquardt import bounded
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.compare import draws

from ..evidence.residuals import Evidence
from ..evidence.space import Space
from ..policy import Policy
from ..search.fit import Point, refit_reusing_jacobian
from .groups import GROUPS

Set = frozenset[str]


class Sets:
    """Fits by set of free groups, each made once.

    phi: overdispersion of the scores of units; every: groups of which anything is free.
    """

    def __init__(self, evidence: Evidence, base: Vehicle, full: Point, unit: IntArray,
                 known: Mapping[str, float], policy: Policy) -> None:
        """base: the model as given; full: the last fit; unit (N,): what is drawn together."""
        self.evidence, self.base, self.full = evidence, base, full
        self.unit, self.known, self.policy = unit, known, policy
        effects = {a.name for a in full.vehicle.effects} - {a.name for a in base.effects}
        self.free = tuple(n for n in full.space.names if n.partition(".")[0] not in effects)
        self._names = {g: group.of(self.free) for g, group in GROUPS.items()}
        self.every = frozenset(g for g, names in self._names.items() if names)
        self.phi = dispersion(full, unit)
        pull = np.diag(full.space.prior_weight + 1e-6)
        self.normal = (full.normal - pull) / self.phi + pull
        self._fits: dict[Set, Point] = {}

    def names(self, group: str) -> tuple[str, ...]:
        """Free parameters of a group."""
        return self._names[group]

    def coordinates(self, group: str) -> list[int]:
        """Of the last fit, those of a group."""
        return [self.full.space.names.index(n) for n in self._names[group]]

    def fit(self, free: Set) -> Point:
        """Fitted anew with some groups at the values of the model."""
        if free not in self._fits:
            p = self.full.vehicle
            names = tuple(n for n in self.free
                          if any(n in self.names(g) for g in free) or not _grouped(n))
            vehicle = with_nulls(self.base, p.effects)
            space = Space(vehicle, names, self.known, self.evidence.message_age, self.policy.prior,
                          self.full.space.loose)
            x = space.transfer(space.start(p, self.full.timing), self.full.space, self._held(free))
            self._fits[free] = refit_reusing_jacobian(self.evidence, self.full.noise, space, x,
                                                      self.full)
        return self._fits[free]

    def _held(self, free: Set) -> FloatArray:
        """(k,) the last fit with the other groups where the model has them, to second order.

            x + m,  m = argmin m^T H m  where  m_out = -x_out,  low <= x + m <= high

        Without the bounds a command younger than its message would stand in for a delay.
        """
        held = [i for g in sorted(self.every - free) for i in self.coordinates(g)]
        space, x, normal = self.full.space, self.full.x.copy(), self.full.normal
        rest = np.setdiff1d(np.arange(len(x)), held)
        x[rest] += bounded(normal[np.ix_(rest, rest)], -normal[rest][:, held] @ x[held],
                           space.low[rest] - x[rest], space.high[rest] - x[rest])
        x[held] = 0.0
        return np.asarray(x)

    def losses(self, free: Set) -> FloatArray:
        """(u,) loss of each unit; from the last fit on to first order where that is not far."""
        if self.rise(free) < self.policy.claims.near:
            point, move = self.full, self._held(free) - self.full.x
            residual = point.residual + point.jacobian @ move
        else:
            point = self.fit(free)
            residual, move = point.residual, np.zeros(len(point.x))
        by_row = point.weight * point.noise.loss(residual)
        by_row = by_row + point.prior_loss(move) / len(by_row)
        return np.asarray(np.bincount(self.unit, by_row, int(self.unit.max()) + 1),
                          dtype=np.float64)

    def rise(self, free: Set) -> float:
        """By how much the loss rises with the other groups where the model has them.

        To second order, m^T H m: as much as the residuals move.
        """
        move = self._held(free) - self.full.x
        return float(move @ self.full.normal @ move)


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
    """Of the groups that may have moved; those that to second order hardly did are left out.

    From the set that is best to second order, one group at a time leaves or enters as long as a
    fit with it says that this is better; what is nearly as good as the best set stays.
    """
    policy, guessed = of.policy.claims, _guessed(of)
    every = _plausible(of, guessed)
    fitted: dict[Set, float] = {}

    def criterion(s: Set) -> float:
        """-2 log p, but for a constant."""
        if s not in fitted:
            fitted[s] = float(of.losses(s).sum()) / of.phi + _penalty(of, s)
        return fitted[s]

    best, last = min(guessed, key=lambda s: guessed[s]), None
    while best != last:
        last = best
        swaps = [best - {a} | {b} for a in sorted(best) for b in sorted(every - best)]
        near = [*(best ^ {g} for g in sorted(every)),
                *(s for s in swaps if guessed[s] < guessed[best] + policy.swap)]
        best = min([best, *near], key=criterion)
    return _posterior(of, [s for s in fitted if fitted[s] < fitted[best] + policy.certain], seed)


def _posterior(of: Sets, sets: Sequence[Set], seed: int) -> Posterior:
    """With the groups that are not too improbable, the surest first."""
    weight = weights(of, sets, seed)
    every = Posterior(tuple(sorted(frozenset().union(*sets))), tuple(sets), weight)
    seen = [g for g in every.groups if every.of(g) > of.policy.claims.hardly]
    return replace(every, groups=tuple(sorted(seen, key=lambda g: -every.of(g))))


def all_sets(of: Sets, seed: int) -> Posterior:
    """The same of all sets there are, each fitted: what the search is checked against."""
    return _posterior(of, _subsets(of.every), seed)


def _subsets(groups: Set) -> list[Set]:
    ordered = sorted(groups)
    return [frozenset(s) for k in range(len(ordered) + 1) for s in combinations(ordered, k)]


def _guessed(of: Sets) -> dict[Set, float]:
    """-2 log p of every set to second order around the fit with all groups."""
    return {s: of.rise(s) / of.phi + _penalty(of, s) for s in _subsets(of.every)}


def _plausible(of: Sets, guessed: Mapping[Set, float]) -> Set:
    """Groups that are not too improbable by the sets as guessed."""
    least = min(guessed.values())
    weight = {s: float(np.exp(-0.5 * (c - least))) for s, c in guessed.items()}
    enough = of.policy.claims.guessed * sum(weight.values())
    return frozenset(g for g in of.every if sum(w for s, w in weight.items() if g in s) > enough)


def _penalty(of: Sets, s: Set) -> float:
    """Of a set, for being improbable and for what else its parameters could have been."""
    q = of.policy.claims.prior
    mine = [i for g in sorted(s) for i in of.coordinates(g)]
    grouped = {i for g in of.every for i in of.coordinates(g)}
    beside = [i for i in range(len(of.full.x)) if i not in grouped]

    def log_det(some: Sequence[int]) -> float:
        return float(np.linalg.slogdet(of.normal[np.ix_(some, some)])[1]) if len(some) else 0.0

    return (log_det([*beside, *mine]) - log_det(beside)
            + 2.0 * len(s) * float(np.log((1.0 - q) / q)))


def weights(of: Sets, sets: Sequence[Set], seed: int) -> FloatArray:
    """(sets,) posterior, mean over draws of units."""
    losses = np.stack([of.losses(s) for s in sets], axis=1)
    counts = draws(np.arange(len(losses)), of.policy.claims.draws, seed)
    penalty = np.array([_penalty(of, s) for s in sets])
    log = -counts @ losses / (2.0 * of.phi) - 0.5 * penalty
    p = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray((p / p.sum(axis=1, keepdims=True)).mean(axis=0))


def dispersion(point: Point, unit: IntArray) -> float:
    """How much more the scores of units differ than independent residuals would make them."""
    scores = point.block_gradients(unit)
    scores = scores - scores.mean(axis=0)
    n = len(scores)
    spread = np.trace(np.linalg.solve(point.normal, scores.T @ scores)) / len(point.x)
    return max(1.0, float(spread) * n / max(n - 1, 1))


def _grouped(name: str) -> bool:
    return any(name.startswith(g.names) for g in GROUPS.values())

