"""Selection: which effect of a round is accepted, if any, and why the others are rejected."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from dart_hal.core.config.model import Covariance
from dart_hal.vehicle.effects import effect_for
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.rows import RowLabels, label_rows
from dart_lab.identification.objective import Point

from ..gates import Candidate, explain_failure, relative_size
from ..policy import USUAL, Policy
from .confounders import MIN_GAIN_SHARE, find_confounders
from .scan import Trial
from .significance import simulate_null

FitEffect = Callable[[Point, Trial], Point]
# Fits of a round to find the best explanation ...
MAX_EXPLANATIONS = 3
MIN_KEPT_SHARE = 0.5  # ... which reaches this share of the linearly predicted gain


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of a search: see ``diagnose``.

    free: parameters of the base that are fitted. unbounded: those that may leave the standard
    errors of ``known`` at the price of their prior alone. refit: the effects of the base are fitted
    as well.
    joint: covariance of parameters by a joint fit of the model; None: standard errors alone.
    stated, stated_together: standard errors and covariance of parameters that keep their values, by
    the diagnosis that fitted them; none with a refit.
    """

    free: tuple[str, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict)
    unbounded: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    false_alarm: float = 0.01
    max_causes: int = 12
    jobs: int = 1
    seed: int = 0
    policy: Policy = USUAL
    refit: bool = True
    joint: Covariance | None = None
    stated: Mapping[str, float] = field(default_factory=dict)
    stated_together: Covariance | None = None


@dataclass(frozen=True, slots=True)
class AcceptedEffect:
    """An accepted effect: its p-value and gain in its round, and its confounders.

    threshold: the minimum gain in that round. alternatives: effects with enough gain in that round
    to be a confounder once all causes are included.
    """

    effect: str
    p_value: float
    gain: float
    threshold: float
    confounders: tuple[str, ...]
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RejectedEffect:
    """An effect of the last round that was not accepted, and the reason."""

    effect: str
    p_value: float
    gain: float
    reason: str


@dataclass(frozen=True, slots=True)
class SelectionStep:
    """Result of one round. accepted: the effect and the fit with it, or None."""

    accepted: tuple[AcceptedEffect, Point] | None
    rejected: tuple[RejectedEffect, ...]


def fit_best_trials(point: Point, trials: Sequence[Trial], fit_effect: FitEffect
                    ) -> dict[str, Point]:
    """Fit the trials with the largest gain until one reaches half of the predicted gain; by effect.

    A linear prediction can be wrong for a large change. A trial with a wrong prediction must not
    decide which residuals remain after the best explanation.
    """
    fits: dict[str, Point] = {}
    for trial in trials[:MAX_EXPLANATIONS]:
        if trial.gain <= 0.0:
            break
        fits[trial.effect] = fit_effect(point, trial)
        if point.loss() - fits[trial.effect].loss() > MIN_KEPT_SHARE * trial.gain:
            break
    return fits


def lowest_loss_fit(point: Point, fits: Iterable[Point]) -> Point:
    """The fit with the smallest loss, or the point itself if no fit is better."""
    return min((point, *fits), key=lambda fit: fit.loss())


def select_effect(evidence: Evidence, point: Point, trials: Sequence[Trial], fit_effect: FitEffect,
                  settings: Settings, explanations: Mapping[str, Point] | None = None
                  ) -> SelectionStep:
    """Select the effect of a round that passes all gates.

    1. Fit the best trials. The best fit gives the residuals without a cause.
    2. Simulate the null distribution from them: thresholds of the gain by effect.
    3. Order the effects above their threshold by the loss of their fit.
    4. Accept the first that passes the gates of the scan and of the fit.

    trials: largest gain first. explanations: result of ``fit_best_trials``, if already computed.
    """
    rows = label_point_rows(evidence, point)
    fits = dict(fit_best_trials(point, trials, fit_effect) if explanations is None
                else explanations)
    # 1. Residuals after the best explanation: those before would have the cause in them, and every
    #    threshold would be too high.
    rest = lowest_loss_fit(point, fits.values()).residual
    # 2. Gains of all effects if none is in the data.
    null = simulate_null(point, rest, trials, rows.block, settings.seed, evidence.has_mocap)
    limits = null.gain_thresholds([t.effect for t in trials], settings.false_alarm)
    passed = [t for t in trials if t.gain > limits[t.effect]]
    # 3. By the loss after a fit. Trials without a fit have their change of 0, behind those that
    #    lower the loss.
    order = sorted(passed, key=lambda t: fits[t.effect].loss() - point.loss()
                   if t.effect in fits else 0.0)
    accepted: tuple[AcceptedEffect, Point] | None = None
    rejected = list[RejectedEffect]()
    for trial in (*order, *(t for t in trials if t not in passed)):
        p = null.p_value(trial.effect, trial.gain)
        candidate = replace(_candidate(point.vehicle, trial, limits),
                            chosen=accepted[0].effect if accepted else "")
        # 4. Cheap gates before the fit, the others after it.
        reason = explain_failure("scan", candidate, settings.policy)
        if not reason:
            fit = fits[trial.effect] = fits.get(trial.effect) or fit_effect(point, trial)
            gain = point.loss() - fit.loss()
            candidate = replace(candidate, fit_gain=gain, size=_fitted_size(fit, trial.effect))
            reason = explain_failure("fit", candidate, settings.policy)
            if not reason:
                rivals = find_confounders(point, trial, trials, rows, fits,
                                          settings.policy.confounders)
                others = list_alternatives(trial, trials)
                accepted = (AcceptedEffect(trial.effect, p, gain, candidate.threshold, rivals,
                                           others), fit)
        if reason:
            rejected.append(RejectedEffect(trial.effect, p, trial.gain, reason))
    return SelectionStep(accepted, tuple(rejected))


def label_point_rows(evidence: Evidence, point: Point) -> RowLabels:
    """Label the residuals of a point by block, recording and window."""
    return label_rows(evidence, evidence.residuals(point.vehicle, point.timing))


def list_alternatives(trial: Trial, trials: Sequence[Trial]) -> tuple[str, ...]:
    """List the effects with at least a share ``MIN_GAIN_SHARE`` of the gain of a trial."""
    return tuple(t.effect for t in trials
                 if t is not trial and t.gain > max(0.0, MIN_GAIN_SHARE * trial.gain))


def _candidate(p: Vehicle, trial: Trial, thresholds: Mapping[str, float]) -> Candidate:
    """Describe a trial for the gates."""
    return Candidate(gain=trial.gain, threshold=thresholds[trial.effect],
                     size=relative_size(effect_for(p, trial.effect), trial.values))


def _fitted_size(point: Point, name: str) -> float:
    """Relative size of an effect in a fit."""
    active = next(a for a in point.vehicle.effects if a.name == name)
    names = [q.name for q in active.effect.parameters]
    return relative_size(effect_for(point.vehicle, name),
                         dict(zip(names, active.values, strict=True)))
