"""One step of the search: which effect is accepted, if any, and why the others are not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from dart_hal.vehicle.effects import catalogue

from ..evidence.residuals import Evidence
from ..evidence.rows import RowLabels, label_rows
from ..gates import Candidate, explain_failure, relative_size
from ..policy import USUAL, NamingPolicy, Policy
from .confounders import confounders
from .fit import Point
from .pairs import FitWith, one_of_a_pair
from .scan import Trial
from .significance import nothing_missing


@dataclass(frozen=True, slots=True)
class Settings:
    """What a search may do: see ``diagnose``.

    free: parameters of the base that move. refit: the effects of the base move as well.
    """

    free: tuple[str, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    false_alarm: float = 0.01
    max_causes: int = 12
    jobs: int = 1
    seed: int = 0
    policy: Policy = USUAL
    refit: bool = True


@dataclass(frozen=True, slots=True)
class Named:
    """An effect that was accepted: p and gain in its round, and its confounders.

    threshold: what it had to gain in that round.
    alternatives: what gained enough in its round to be a confounder beside all causes.
    """

    effect: str
    p_value: float
    gain: float
    threshold: float
    confounders: tuple[str, ...]
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Rejected:
    """An effect of the last round that was not accepted."""

    effect: str
    p_value: float
    gain: float
    why: str


@dataclass(frozen=True, slots=True)
class Step:
    """accepted: an effect and the fit with it; None where none passes."""

    accepted: tuple[Named, Point] | None
    rejected: tuple[Rejected, ...]


def explain(point: Point, trials: Sequence[Trial], fit_with: FitWith, policy: NamingPolicy
            ) -> dict[str, Point]:
    """Fit the trials that gain most until one keeps half of what it promised; by effect.

    A trial that leads astray, for what is linear ends early, must not be the last word on what the
    best effect would leave.
    """
    fits: dict[str, Point] = {}
    for trial in trials[:policy.explanations]:
        if trial.gain <= 0.0:
            break
        fits[trial.effect] = fit_with(point, trial)
        if point.loss() - fits[trial.effect].loss() > policy.keeps * trial.gain:
            break
    return fits


def least_lossy(point: Point, fits: Iterable[Point]) -> Point:
    """The fit with the smallest loss, or the point itself where none is better."""
    return min((point, *fits), key=lambda fit: fit.loss())


def select(evidence: Evidence, point: Point, trials: Sequence[Trial], fit_with: FitWith,
           settings: Settings, explanations: Mapping[str, Point] | None = None) -> Step:
    """The best effect that passes everything.

    trials: largest gain first. explanations: see ``explain``, where that was done before.
    """
    policy, rows = settings.policy.naming, rows_at(evidence, point, settings.policy)
    fits = dict(explain(point, trials, fit_with, policy) if explanations is None else explanations)
    rest = least_lossy(point, fits.values()).residual
    nothing = nothing_missing(point, rest, trials, rows.block, settings.seed, policy.draws,
                              evidence.has_mocap)
    limits = nothing.needed([t.effect for t in trials], settings.false_alarm)
    passed = [t for t in trials if t.gain > limits[t.effect]]
    large = [t for t in passed
             if not explain_failure("scan", _candidate(t, limits), settings.policy)]
    order = sorted(passed, key=lambda t: fits[t.effect].loss() - point.loss()
                   if t.effect in fits else 0.0)
    before = one_of_a_pair(point, large, trials, limits, fits, fit_with, policy.furthest)
    order.sort(key=lambda t: t is not before)
    accepted: tuple[Named, Point] | None = None
    rejected = list[Rejected]()
    for trial in (*order, *(t for t in trials if t not in passed)):
        p = nothing.p_value(trial.effect, trial.gain)
        candidate = replace(_candidate(trial, limits),
                            chosen=accepted[0].effect if accepted else "")
        why = explain_failure("scan", candidate, settings.policy)
        if not why:
            fit = fits[trial.effect] = fits.get(trial.effect) or fit_with(point, trial)
            gain = point.loss() - fit.loss()
            candidate = replace(candidate, fit_gain=gain, size=_size(fit, trial.effect))
            why = explain_failure("fit", candidate, settings.policy)
            if not why:
                rivals = confounders(point, trial, trials, rows, fits, settings.policy.confounders)
                others = alternatives(trial, trials, settings.policy.confounders.gain)
                accepted = (Named(trial.effect, p, gain, candidate.threshold, rivals, others), fit)
        if why:
            rejected.append(Rejected(trial.effect, p, trial.gain, why))
    return Step(accepted, tuple(rejected))


def rows_at(evidence: Evidence, point: Point, policy: Policy) -> RowLabels:
    """What belongs to what, of the residuals of a point."""
    return label_rows(evidence, evidence.residuals(point.vehicle, point.timing), policy.blocks)


def alternatives(trial: Trial, trials: Sequence[Trial], share: float) -> tuple[str, ...]:
    """What gains enough beside an effect to be its confounder, had it been there."""
    return tuple(t.effect for t in trials
                 if t is not trial and t.gain > max(0.0, share * trial.gain))


def _candidate(trial: Trial, thresholds: Mapping[str, float]) -> Candidate:
    """What the linear answer says of an effect."""
    return Candidate(gain=trial.gain, threshold=thresholds[trial.effect],
                     size=relative_size(catalogue()[trial.effect], trial.values))


def _size(point: Point, name: str) -> float:
    """Size of an effect in a fit, as ``relative_size``."""
    active = next(a for a in point.vehicle.effects if a.name == name)
    names = [q.name for q in active.effect.parameters]
    return relative_size(active.effect, dict(zip(names, active.values, strict=True)))
