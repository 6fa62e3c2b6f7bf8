"""Accept effects that held-out data support.

The training recordings fit and select. The test recordings can only veto a confident effect: it is
not accepted if their errors are no larger without it. An error of the base model is the same in all
stretches of one drive, and may look like an effect in each of them, but not in another drive. A
likely effect needs confirmation: the interval of that ratio must be above 1.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from dart_hal.vehicle.effects import effect_for
from dart_lab.identification.evidence.noise import Noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.objective import Point

from ..gates import IMPROBABLE, Candidate, explain_failure
from ..policy import Policy
from ..result import Constancy, Cost
from ..search.forward import ForwardSearch
from .bag import estimate_sizes_by_recording, grade_effects
from .constancy import assess_constancy
from .secants import Secants, secants


@dataclass(frozen=True, slots=True)
class Grade:
    """Share of draws in which held-out data are predicted better with an effect.

    sizes: by recording, (size relative to the fitted one, its standard error).
    """

    probability: float
    sizes: tuple[tuple[float, float], ...]


class Rejection(NamedTuple):
    """An effect that is not accepted: its probability, and why."""

    probability: float
    why: str


@dataclass(frozen=True, slots=True)
class AcceptedEffects:
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
    """Search, training evidence and functions that the acceptance of effects needs.

    impossible(fit, name): why no car has the size that an effect has there, or "". costs(fit,
    removed): errors of the test recordings by the fits without one effect each, over those of the
    fit with all.
    """

    search: ForwardSearch
    evidence: Evidence
    policy: Policy
    seed: int
    impossible: Callable[[Point, str], str]
    costs: Callable[[Point, Mapping[str, Point]], Mapping[str, Cost]]


def accept_effects(context: Acceptance, points: Sequence[Point], start: Point, noise: Noise,
                   names: Sequence[str]) -> AcceptedEffects:
    """Drop one effect at a time until all are likely, possible and confirmed.

    points: the base, and with one effect more each; start: where the search has ended; names: of
    the effects, the largest gain first.

    1. Drop an effect with an impossible size, else the least probable one, and fit the others
       again: a dropped effect may have lowered the probability of another.
    2. Where all are likely, drop the one that the test recordings confirm least, if they do not.
    3. Re-admit improbable effects, the one with the largest gain first, with which all are likely:
       what made them improbable may have been dropped after them.
    """
    if not names:
        return AcceptedEffects((), (points[0],), {}, {}, {}, {})
    fits = _FitCache(context, start, noise, names, points[0])
    accepted, rejected = fits.drop_failed(fits.grade(names, points[-1]))
    accepted, rejected = fits.readmit(accepted, rejected)
    if not accepted.names:
        return AcceptedEffects((), (points[0],), {}, {}, {}, rejected)
    steps = points
    if accepted.fit is not points[-1]:
        steps = (*context.search.fit_nested(points[0], start, noise, accepted.names[:-1]),
                 accepted.fit)
    linear = accepted.linear
    return AcceptedEffects(
        accepted.names, tuple(steps), fits.costs(accepted),
        {n: Grade(p, estimate_sizes_by_recording(linear, n))
         for n, p in accepted.probability.items()},
        {n: assess_constancy(linear, n, context.policy.grade, context.seed)
         for n in accepted.names},
        rejected)


class _GradedFit(NamedTuple):
    """Effects, the fit with them, its linearisation, and the probability of each effect."""

    names: tuple[str, ...]
    fit: Point
    linear: Secants
    probability: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class _FitCache:
    """Fits of subsets of the effects, from one start, each computed once; base: without any."""

    context: Acceptance
    start: Point
    noise: Noise
    names: Sequence[str]
    base: Point
    _done: dict[tuple[str, ...], Point] = field(default_factory=dict)

    def grade(self, names: Sequence[str], fit: Point) -> _GradedFit:
        """Compute the probability of each effect of a fit."""
        evidence = self.context.evidence
        linear = secants(evidence, fit, names,
                         self.context.search.linearise_stated(evidence, fit))
        return _GradedFit(tuple(names), fit, linear,
                          grade_effects(linear, names, self.context.seed)
                          if names else {})

    def fit(self, names: Collection[str], neighbour: Point) -> Point:
        """Return the fit with these effects, from one with nearly the same."""
        ordered = self._sort(names)
        if not ordered:
            return self.base
        if ordered not in self._done:
            self._done[ordered] = self.context.search.fit_subset(self.start, self.noise, ordered,
                                                          neighbour)
        return self._done[ordered]

    def grade_subset(self, names: Collection[str], neighbour: Point) -> _GradedFit:
        """Fit these effects from a fit with nearly the same, and compute their probabilities."""
        return self.grade(self._sort(names), self.fit(names, neighbour))

    def drop_failed(self, current: _GradedFit) -> tuple[_GradedFit, dict[str, Rejection]]:
        """Drop effects until the rest are likely, possible and confirmed."""
        rejected: dict[str, Rejection] = {}
        while current.names:
            candidates = self.candidates(current)
            # 1. An impossible size first: such an effect absorbs an error of another kind, and the
            #    others are fitted wrongly with it.
            whys = self.failures("grade", candidates)
            impossible = [n for n in whys if candidates[n].impossible]
            worst = min(impossible or current.names, key=lambda n: current.probability[n])
            if not whys:
                # 2. Only then the test recordings, which need a fit without each effect.
                candidates = self.candidates(current, self.costs(current))
                whys = self.failures("test", candidates)
                if not whys:
                    break
                worst = min(whys, key=lambda n: candidates[n].confirmation(self.context.policy))
            rejected[worst] = Rejection(current.probability[worst], whys[worst])
            current = self.grade_subset(set(current.names) - {worst}, current.fit)
        return current, rejected

    def candidates(self, current: _GradedFit, costs: Mapping[str, Cost] | None = None
                   ) -> dict[str, Candidate]:
        """Return each effect for its gates; costs: once the test recordings were predicted."""
        out = {}
        for name in current.names:
            known = Candidate(probability=current.probability[name],
                              impossible=self.context.impossible(current.fit, name))
            out[name] = replace(known, cost=costs[name]) if costs else known
        return out

    def failures(self, stage: str, candidates: Mapping[str, Candidate]) -> dict[str, str]:
        """Return why effects do not pass a stage, for those that do not."""
        whys = {n: explain_failure(stage, c, self.context.policy) for n, c in candidates.items()}
        return {n: why for n, why in whys.items() if why}

    def costs(self, current: _GradedFit) -> Mapping[str, Cost]:
        """Return the errors of the test recordings without each effect, over those with all."""
        return self.context.costs(current.fit, {
            n: self.fit(set(current.names) - {n}, current.fit) for n in current.names})

    def readmit(self, current: _GradedFit, rejected: Mapping[str, Rejection]
                ) -> tuple[_GradedFit, dict[str, Rejection]]:
        """Add each improbable effect with which all are likely, possible and confirmed."""
        remaining = dict(rejected)
        for name in self.names:
            one = rejected.get(name)
            if (one is None or one.why != IMPROBABLE
                    or one.probability < self.context.policy.grade.possible_probability):
                continue
            # 3. An effect comes back only if no other one fails with it: this step adds, it never
            #    exchanges.
            more = self.grade_subset({*current.names, name}, current.fit)
            if self.failures("grade", self.candidates(more)):
                continue
            if not self.failures("test", self.candidates(more, self.costs(more))):
                current = more
                del remaining[name]
        return current, remaining

    def _sort(self, names: Collection[str]) -> tuple[str, ...]:
        """Sort effects by their gain, the largest first."""
        return tuple(n for n in self.names if n in names)


def impossible_size(fit: Point, name: str) -> str:
    """Return why no car has the size that an effect has in a fit; empty if one may have it."""
    active = next(a for a in fit.vehicle.effects if a.name == name)
    whys = (q.impossible(float(value))
            for q, value in zip(effect_for(fit.vehicle, name).parameters, active.values,
                                strict=True))
    return "; ".join(why for why in whys if why)
