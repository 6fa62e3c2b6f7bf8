"""Which groups were wrong: the posterior over the sets of groups that have changed.

For a set S, each parameter outside of it keeps the value of the model; effects and timing are free:

    L_u(S) = sum_(i in u) w_i rho(r_i(x_S)),  x_S = argmin J over the free parameters     by unit u
    log p(S) = -sum_u c_u L_u(S) / 2 phi - 1/2 ln det H_S + |S| ln q + |not S| ln(1 - q) + const
    phi = max(1, tr(B^-1 sum_u s_u s_u^T) / k)      overdispersion of the scores of units
    P(g) = mean over draws c of sum_(S with g) p_c(S)

H_S: normal matrix of the parameters of S, in prior standard deviations, with the other free ones
projected out: Laplace's evidence, so that a parameter that the data hardly determine costs nothing.
The age of commands is free in every fit, so it is not found as a delay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dart_hal.core.config.model import Covariance
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.effects import add_null_effects
from dart_hal.vehicle.fitting.levenberg_marquardt import solve_box_quadratic
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.compare import draw_blocks
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import Space
from dart_lab.identification.objective import Point, refit_reusing_jacobian

from ..policy import Policy
from .groups import GROUPS

# Prior probability that a group is wrong: one or two of the usual seven.
PRIOR_PROBABILITY = 0.2
# Twice a log probability: a set that is worse by it has no weight, e^6 to one.
MAX_CRITERION_GAP = 12.0
# Draws of units.
UNIT_DRAWS = 128
# Loss below which a set needs no fit, as its residuals are linear: five standard deviations.
MAX_LINEAR_RISE = 25.0
# Of the criterion to second order, which is inexact for far moves: an exchange of two groups that
# is worse by more is not fitted.
MAX_SWAP_GAP = 100.0
# Probability below which a group is not looked at again, and to second order not fitted.
MIN_GROUP_PROBABILITY = 0.05
MIN_GUESSED_PROBABILITY = 0.01

GroupSet = frozenset[str]


class GroupFits:
    """Fits by set of free groups, each computed once.

    phi: overdispersion of the scores of units; all_groups: groups with any free parameter.
    """

    def __init__(self, evidence: Evidence, base: Vehicle, full: Point, unit: IntArray,
                 known: Mapping[str, float], policy: Policy, joint: Covariance | None = None
                 ) -> None:
        """base: the model as given; full: the last fit; unit (N,): rows that are drawn together.

        joint: covariance of parameters that the file of the model states.
        """
        self.evidence = evidence
        self.base = base
        self.full = full
        self.unit = unit
        self.known = known
        self.policy = policy
        self.joint = joint
        effects = {a.name for a in full.vehicle.effects} - {a.name for a in base.effects}
        self.free = tuple(n for n in full.space.names if n.partition(".")[0] not in effects)
        self._names = {g: group.select(self.free) for g, group in GROUPS.items()}
        self.all_groups = frozenset(g for g, names in self._names.items() if names)
        self.phi = dispersion(full, unit)
        # Information of the data is divided by their overdispersion phi; that of the prior is not.
        prior = full.space.prior_precision + 1e-6 * np.eye(len(full.x))
        self.normal = (full.normal - prior) / self.phi + prior
        self._fits: dict[GroupSet, Point] = {}

    def names(self, group: str) -> tuple[str, ...]:
        """Return the free parameters of a group."""
        return self._names[group]

    def coordinates(self, group: str) -> list[int]:
        """Return the indices of a group in the last fit."""
        return [self.full.space.names.index(n) for n in self._names[group]]

    def fit(self, free: GroupSet) -> Point:
        """Fit with some groups free, and the others at the values of the model."""
        if free not in self._fits:
            p = self.full.vehicle
            names = tuple(n for n in self.free
                          if any(n in self.names(g) for g in free) or not _has_group(n))
            vehicle = add_null_effects(self.base, p.effects)
            space = Space(vehicle, names, self.known, self.evidence.message_age, self.policy.prior,
                          self.full.space.loose)
            x = space.transfer(space.start(p, self.full.timing), self.full.space,
                               self._constrain(free))
            self._fits[free] = refit_reusing_jacobian(self.evidence, self.full.noise, space, x,
                                                      self.full)
        return self._fits[free]

    def _constrain(self, free: GroupSet) -> FloatArray:
        """Return the last fit (k,) with the other groups at the model's values, to second order.

            x + m,  m = argmin m^T H m  where  m_out = -x_out,  low <= x + m <= high

        Without the bounds, a command younger than its message could replace a delay.
        """
        # Around the last fit J(x + m) = J + m^T H m: its gradient is zero there. With m_out fixed,
        # the others minimise m_in^T H_ii m_in + 2 m_in^T H_io m_out within their bounds.
        fixed = [i for g in sorted(self.all_groups - free) for i in self.coordinates(g)]
        space = self.full.space
        x = self.full.x.copy()
        normal = self.full.normal
        rest = np.setdiff1d(np.arange(len(x)), fixed)
        x[rest] += solve_box_quadratic(
            normal[np.ix_(rest, rest)], -normal[rest][:, fixed] @ x[fixed],
            space.low[rest] - x[rest], space.high[rest] - x[rest])
        x[fixed] = 0.0
        return np.asarray(x)

    def losses(self, free: GroupSet) -> FloatArray:
        """Return the loss (u,) of each unit; to first order if the last fit is near."""
        # A set whose parameters hardly move needs no fit: its residuals are linear there.
        if self.rise(free) < MAX_LINEAR_RISE:
            point = self.full
            move = self._constrain(free) - self.full.x
            residual = point.residual + point.jacobian @ move
        else:
            point = self.fit(free)
            residual = point.residual
            move = np.zeros(len(point.x))
        by_row = point.weight * point.noise.loss(residual)
        # The loss of the prior belongs to no unit: spread it over all rows.
        by_row = by_row + point.prior_loss(move) / len(by_row)
        return np.asarray(np.bincount(self.unit, by_row, int(self.unit.max()) + 1),
                          dtype=np.float64)

    def rise(self, free: GroupSet) -> float:
        """Return the rise of the loss with the other groups fixed, to second order: m^T H m."""
        move = self._constrain(free) - self.full.x
        return float(move @ self.full.normal @ move)


@dataclass(frozen=True, slots=True)
class Posterior:
    """weight (sets,) of sets of groups; groups: those that may have changed, by probability."""

    groups: tuple[str, ...]
    sets: tuple[GroupSet, ...]
    weight: FloatArray

    def probability(self, *groups: str) -> float:
        """Return P that any of these groups has left its old value."""
        return float(self.weight @ np.array([bool(s & set(groups)) for s in self.sets]))

    def probability_without(self, group: str) -> dict[str, float]:
        """Return P of each other group without this one."""
        return {g: float(self.weight @ np.array([g in s and group not in s for s in self.sets]))
                for g in self.groups if g != group}


def posterior(fits: GroupFits, seed: int) -> Posterior:
    """Compute the posterior over the sets that are not too improbable.

    1. Approximate the criterion -2 log p of all sets to second order, and start from the best.
    2. Fit the sets with one group more, one less, and one for another. Go to the best of them,
       until no neighbour is better.
    3. Weigh the fitted sets that are nearly as good as the best one.
    """
    approximate = _approximate_criteria(fits)
    groups = _select_plausible(fits, approximate)
    fitted: dict[GroupSet, float] = {}

    def criterion(s: GroupSet) -> float:
        """-2 log p, but for a constant."""
        if s not in fitted:
            fitted[s] = float(fits.losses(s).sum()) / fits.phi + _penalty(fits, s)
        return fitted[s]

    # 1. The best set by the quadratic approximation.
    best = min(approximate, key=lambda s: approximate[s])
    last = None
    while best != last:
        last = best
        # 2. Neighbours: one group more or less, or one exchanged. An exchange is only fitted where
        #    the approximation does not rule it out.
        swaps = [best - {a} | {b} for a in sorted(best) for b in sorted(groups - best)]
        near = [*(best ^ {g} for g in sorted(groups)),
                *(s for s in swaps if approximate[s] < approximate[best] + MAX_SWAP_GAP)]
        best = min([best, *near], key=criterion)
    # 3. Sets that are far worse have no weight.
    limit = fitted[best] + MAX_CRITERION_GAP
    return _posterior(fits, [s for s in fitted if fitted[s] < limit], seed)


def _posterior(fits: GroupFits, sets: Sequence[GroupSet], seed: int) -> Posterior:
    """Return the posterior over some sets, with the groups that are not too improbable."""
    weight = posterior_weights(fits, sets, seed)
    found = Posterior(tuple(sorted(frozenset().union(*sets))), tuple(sets), weight)
    groups = [g for g in found.groups if found.probability(g) > MIN_GROUP_PROBABILITY]
    return replace(found, groups=tuple(sorted(groups, key=lambda g: -found.probability(g))))


def posterior_of_all_sets(fits: GroupFits, seed: int) -> Posterior:
    """Return the posterior over all sets, each fitted, as a reference for ``posterior``."""
    return _posterior(fits, _subsets(fits.all_groups), seed)


def _subsets(groups: GroupSet) -> list[GroupSet]:
    ordered = sorted(groups)
    return [frozenset(s) for k in range(len(ordered) + 1) for s in combinations(ordered, k)]


def _approximate_criteria(fits: GroupFits) -> dict[GroupSet, float]:
    """Return -2 log p of every set to second order around the fit with all groups."""
    return {s: fits.rise(s) / fits.phi + _penalty(fits, s) for s in _subsets(fits.all_groups)}


def _select_plausible(fits: GroupFits, approximate: Mapping[GroupSet, float]) -> GroupSet:
    """Return groups that are not too improbable by the approximate criteria."""
    # exp(-c / 2), relative to the best set: unnormalised probabilities.
    least = min(approximate.values())
    weight = {s: float(np.exp(-0.5 * (c - least))) for s, c in approximate.items()}
    enough = MIN_GUESSED_PROBABILITY * sum(weight.values())
    return frozenset(g for g in fits.all_groups
                     if sum(w for s, w in weight.items() if g in s) > enough)


def _penalty(fits: GroupFits, s: GroupSet) -> float:
    """Return -2 log of the prior of a set, and of the Laplace volume of its parameters."""
    mine = [i for g in sorted(s) for i in fits.coordinates(g)]
    grouped = {i for g in fits.all_groups for i in fits.coordinates(g)}
    others = [i for i in range(len(fits.full.x)) if i not in grouped]

    # ln det of the Schur complement H_SS - H_SO H_OO^-1 H_OS is the difference of two ln det: that
    # of S with the others, and of the others alone.
    def log_det(some: Sequence[int]) -> float:
        return float(np.linalg.slogdet(fits.normal[np.ix_(some, some)])[1]) if len(some) else 0.0

    return (log_det([*others, *mine]) - log_det(others)
            + 2.0 * len(s) * float(np.log(1.0 / PRIOR_PROBABILITY - 1.0)))


def posterior_weights(fits: GroupFits, sets: Sequence[GroupSet], seed: int) -> FloatArray:
    """Return the posterior (sets,), the mean over draws of units."""
    # Bootstrap over units: each draw weighs the units by how often they were drawn, and gives a
    # posterior; their mean is less certain than one of all units.
    losses = np.stack([fits.losses(s) for s in sets], axis=1)
    counts = draw_blocks(np.arange(len(losses)), UNIT_DRAWS, seed)
    penalty = np.array([_penalty(fits, s) for s in sets])
    log = -counts @ losses / (2.0 * fits.phi) - 0.5 * penalty
    # Relative to the largest, so that exp does not underflow.
    p = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray((p / p.sum(axis=1, keepdims=True)).mean(axis=0))


def dispersion(point: Point, unit: IntArray) -> float:
    """Return by how much the scores of units vary more than independent residuals would imply."""
    # For independent residuals the covariance of the scores is H, so tr(H^-1 S) = k.
    scores = point.block_gradients(unit)
    scores = scores - scores.mean(axis=0)
    n = len(scores)
    spread = np.trace(np.linalg.solve(point.normal, scores.T @ scores)) / len(point.x)
    return max(1.0, float(spread) * n / max(n - 1, 1))


def _has_group(name: str) -> bool:
    return any(g.select((name,)) for g in GROUPS.values())
