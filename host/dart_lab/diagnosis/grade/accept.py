"""Accept effects that data left out of their fit support.

The training recordings fit and select. The test recordings can only veto a confident effect: it is
not accepted if their errors are no larger without it. An error of the base is the same in all
stretches of one drive, and may look like an effect in each of them, but not in another drive. A
likely effect needs confirmation: the interval of that ratio must lie above 1.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ..evidence.noise import Noise
from ..evidence.residuals import Evidence
from ..gates import IMPROBABLE, Candidate, explain_failure
from ..policy import Policy
from ..result import Constancy, Cost
from ..search.fit import Point
from ..search.forward import ForwardSearch
from .bag import grades, sizes
from .constancy import constancy
from .secants import Secants, secants


@dataclass(frozen=True, slots=True)
class Grade:
    """Share of draws in which data left out of the fit are predicted better with an effect.

    sizes: by recording, (size relative to the fitted one, its standard error).
    """

    probability: float
    sizes: tuple[tuple[float, float], ...]


class Rejection(NamedTuple):
    """An effect that is not accepted: its probability, and why."""

    probability: float
    why: str


@dataclass(frozen=True, slots=True)
class Accepted:
    """Accepted effects in the order of their gain.

    points: the base, and the fits with one effect more each; costs: errors of the test recordings
    without each effect over those with all; rejected: by effect.
    """

    names: tuple[str, ...]
    points: tuple[Point, ...]
    costs: Mapping[str, Cost]
    grades: Mapping[str, Grade]
    constancy: Mapping[str, Constancy]
    rejected: Mapping[str, Rejection]


@dataclass(frozen=True, slots=True)
class Acceptance:
    """What it takes to accept: the search that made the fits, and the training evidence.

    impossible(fit, name): why no car has the size that an effect has there, or "". costs(fit,
    without): errors of the test recordings by the fits without one effect each, over those of the
    fit with all.
    """

    search: ForwardSearch
    evidence: Evidence
    policy: Policy
    seed: int
    impossible: Callable[[Point, str], str]
    costs: Callable[[Point, Mapping[str, Point]], Mapping[str, Cost]]


def accept_effects(how: Acceptance, points: Sequence[Point], at: Point, noise: Noise,
                   names: Sequence[str]) -> Accepted:
    """Drop one effect at a time until all are likely, possible and confirmed.

    points: the base, and with one effect more each; at: where the search has ended; names: of the
    effects, the largest gain first.

    1. Drop an effect with an impossible size, else the least probable one, and fit the others
       again: an effect that is dropped may have been what hid another.
    2. Where all are likely, drop the one that the test recordings confirm least, if they do not.
    3. Take improbable ones back, the one with the largest gain first, with which all are likely:
       what made them improbable may have been dropped after them.
    """
    if not names:
        return Accepted((), (points[0],), {}, {}, {}, {})
    fits = _Fits(how, at, noise, names, points[0])
    kept, rejected = fits.drop(fits.graded(names, points[-1]))
    kept, rejected = fits.take_back(kept, rejected)
    if not kept.names:
        return Accepted((), (points[0],), {}, {}, {}, rejected)
    steps = points
    if kept.fit is not points[-1]:
        steps = (*how.search.fit_nested(points[0], at, noise, kept.names[:-1]), kept.fit)
    return Accepted(kept.names, tuple(steps),
                    fits.costs(kept),
                    {n: Grade(p, sizes(kept.of, n)) for n, p in kept.probability.items()},
                    {n: constancy(kept.of, n, how.policy.grade, how.seed) for n in kept.names},
                    rejected)


class _Graded(NamedTuple):
    """Effects, the fit with them, what each did in it, and how probable each is."""

    names: tuple[str, ...]
    fit: Point
    of: Secants
    probability: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class _Fits:
    """Fits of some of the effects, from one start, each done once; base: the one without any."""

    how: Acceptance
    at: Point
    noise: Noise
    names: Sequence[str]
    base: Point
    _done: dict[tuple[str, ...], Point] = field(default_factory=dict)

    def graded(self, names: Sequence[str], fit: Point) -> _Graded:
        """How probable each effect of a fit is."""
        policy, seed = self.how.policy, self.how.seed
        of = secants(self.how.evidence, fit, names, policy)
        return _Graded(tuple(names), fit, of,
                       grades(of, names, policy.grade, seed) if names else {})

    def fit(self, names: Collection[str], near: Point) -> Point:
        """The fit with these effects, from one with nearly the same."""
        ordered = self._ordered(names)
        if not ordered:
            return self.base
        if ordered not in self._done:
            self._done[ordered] = self.how.search.fit_subset(self.at, self.noise, ordered, near)
        return self._done[ordered]

    def of(self, names: Collection[str], near: Point) -> _Graded:
        """How probable each of these effects is, fitted from a fit with nearly the same."""
        return self.graded(self._ordered(names), self.fit(names, near))

    def drop(self, those: _Graded) -> tuple[_Graded, dict[str, Rejection]]:
        """Drop effects until the rest are likely, possible and confirmed."""
        rejected: dict[str, Rejection] = {}
        while those.names:
            candidates = self.candidates(those)
            whys = self.failures("grade", candidates)
            impossible = [n for n in whys if candidates[n].impossible]
            worst = min(impossible or those.names, key=lambda n: those.probability[n])
            if not whys:
                candidates = self.candidates(those, self.costs(those))
                whys = self.failures("test", candidates)
                if not whys:
                    break
                worst = min(whys, key=lambda n: candidates[n].confirmation(self.how.policy))
            rejected[worst] = Rejection(those.probability[worst], whys[worst])
            those = self.of(set(those.names) - {worst}, those.fit)
        return those, rejected

    def candidates(self, those: _Graded, costs: Mapping[str, Cost] | None = None
                   ) -> dict[str, Candidate]:
        """What is known of each effect; costs: once the test recordings were predicted."""
        out = {}
        for name in those.names:
            known = Candidate(probability=those.probability[name],
                              impossible=self.how.impossible(those.fit, name))
            out[name] = replace(known, cost=costs[name]) if costs else known
        return out

    def failures(self, stage: str, candidates: Mapping[str, Candidate]) -> dict[str, str]:
        """Why effects do not pass a stage, of those that do not."""
        whys = {n: explain_failure(stage, c, self.how.policy) for n, c in candidates.items()}
        return {n: why for n, why in whys.items() if why}

    def costs(self, those: _Graded) -> Mapping[str, Cost]:
        """Errors of the test recordings without each effect, over those with all."""
        return self.how.costs(those.fit, {n: self.fit(set(those.names) - {n}, those.fit)
                                          for n in those.names})

    def take_back(self, those: _Graded, rejected: Mapping[str, Rejection]
                  ) -> tuple[_Graded, dict[str, Rejection]]:
        """Add each improbable effect with which all are likely, possible and confirmed."""
        away = dict(rejected)
        for name in self.names:
            one = rejected.get(name)
            if (one is None or one.why != IMPROBABLE
                    or one.probability < self.how.policy.grade.possible):
                continue
            more = self.of({*those.names, name}, those.fit)
            if self.failures("grade", self.candidates(more)):
                continue
            if not self.failures("test", self.candidates(more, self.costs(more))):
                those = more
                del away[name]
        return those, away

    def _ordered(self, names: Collection[str]) -> tuple[str, ...]:
        return tuple(n for n in self.names if n in names)


def impossible_size(fit: Point, name: str) -> str:
    """Why no car has the size that an effect has in a fit; empty where one may have it."""
    active = next(a for a in fit.vehicle.effects if a.name == name)
    whys = (q.impossible(float(value))
            for q, value in zip(active.effect.parameters, active.values, strict=True))
    return "; ".join(why for why in whys if why)
