"""Forward search: accept the best effect, refit everything, repeat, and drop redundant effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.timing import PWM_WAIT_STD
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import add_null_effects, apply, catalogue, remove_effects
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.ages import START_AGES, age_sensitivity
from dart_lab.identification.evidence.noise import Noise, estimate_noise
from dart_lab.identification.evidence.residuals import Evidence, affects_readings_only
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import (
    Point,
    StatedParameters,
    change_noise,
    evaluate_point,
    loss_at,
    refit,
    refit_extended,
    refit_reusing_jacobian,
)

from ..gates import Candidate, explain_failure
from ..unexplained.driven import remove_driven_motion
from .confounders import find_confounders, select_correlated
from .scan import Progress, Sweep, Trial, scan
from .selection import (
    AcceptedEffect,
    RejectedEffect,
    Settings,
    fit_best_trials,
    label_point_rows,
    lowest_loss_fit,
    select_effect,
)

Sweeps = Mapping[str, Sequence[Sweep]]
# Fits of the base. The second is weighted by the residuals of the first.
BASE_NOISE_PASSES = 2
# Fits with a new effect, each with the noise that the last one leaves, until the sum of the log
# standard deviations (15 of the motion, 4 of sensors) falls by less: 0.5 % of each.
MAX_NOISE_PASSES = 5
VOLUME_TOLERANCE = 0.1
# Times that the noise is measured without the best explanation in a round; each halves the rest.
MAX_NOISE_SEPARATIONS = 3
# Thresholds; an effect with that statistic is not tested again when another one is added.
CERTAIN_RATIO = 4.0


@dataclass(frozen=True, slots=True)
class SearchResult:
    """Result of a search.

    given: the model without a refit, at the best timing. points: the fitted base, then fits with
    one more effect each. ranking: trials of the first round.

    noise: noise of the residuals of the last point, with which the causes are estimated. With the
    noise of the base, a cause would be part of the noise: its own directions would have little
    weight, and its size would be estimated too small. base_noise: noise of the residuals of the
    base.

    add_confounders: adds to an accepted effect its confounders, given all other accepted effects.
    """

    given: Point
    points: tuple[Point, ...]
    noise: Noise
    base_noise: Noise
    accepted: tuple[AcceptedEffect, ...]
    rejected: tuple[RejectedEffect, ...]
    ranking: tuple[Trial, ...]
    add_confounders: Callable[[AcceptedEffect], AcceptedEffect]

    @property
    def refit_loss(self) -> float:
        """Reduction of the loss by the refit of the base."""
        return self.given.loss() - self.base.loss()

    @property
    def base(self) -> Point:
        return self.points[0]

    @property
    def point(self) -> Point:
        """The fit with all accepted effects."""
        return self.points[-1]


def select_noise(effects: Sequence[str], noise: Noise, base_noise: Noise) -> Noise:
    """Select the noise; the motion of the base if all effects change only readings.

    Such effects are no part of the noise of the motion. Measuring it again would change the fit of
    the base, so that a cause in a sensor would change the predicted motion.
    """
    if all(affects_readings_only(catalogue()[name]) for name in effects):
        return noise.with_motion(base_noise)
    return noise


class ForwardSearch:
    """Forward search on the training evidence."""

    def __init__(self, evidence: Evidence, base: Vehicle, settings: Settings,
                 progress: Progress | None = None,
                 on_base_fitted: Callable[[], None] | None = None) -> None:
        """on_base_fitted: called when the fit of the base is complete."""
        self._evidence = evidence
        self._settings = settings
        self._progress = progress
        self._on_base_fitted = on_base_fitted
        self.base = base
        self._done_share = 0.0
        self._dropped = False
        self._sweeps: Sweeps = {}
        self._freed: tuple[str, ...] = settings.unbounded

    def run(self) -> SearchResult:
        """Search until no effect is accepted; free parameters that end on their bound and repeat.

        An effect is accepted for what parameters within their stated errors cannot explain. If a
        parameter is on the bound of its stated error at the end, that error was too small. The
        accepted effect, or the remaining structure, may be a result of the bound. Such parameters
        are freed, and the search starts again. Only for own recordings, which have time stamps of
        the commands.
        """
        found = self._run_once()
        while self._evidence.commands_stamped and (more := self._parameters_at_bound(found.point)):
            self._freed += more
            self._sweeps = {}
            self._dropped = False
            found = self._run_once()
        return found

    def _parameters_at_bound(self, point: Point) -> tuple[str, ...]:
        """Parameters on the bound of their stated error."""
        return point.space.names_at_bound(point.x, self._settings.policy.prior.max_stated_stds)

    def _run_once(self) -> SearchResult:
        """Run the rounds of the search once."""
        s = self._settings
        # 1. Fit the base and measure the noise.
        space = self.make_space(self.base)
        point, noise = self._fit_and_measure_noise(space, MessageTiming(self._evidence.message_age))
        if self._on_base_fitted is not None:
            self._on_base_fitted()
        # The model as given, for comparison: only its timing is fitted.
        fixed = Space(self.base, (), message_age=self._evidence.message_age, policy=s.policy.prior,
                      fixed_effects=effect_names(self.base))
        given = refit(self._evidence, noise, fixed, fixed.point(point.timing))
        base = point
        base_noise = noise
        first = tuple[Trial, ...]()
        accepted = list[AcceptedEffect]()
        rejected = tuple[RejectedEffect, ...]()
        # 2. Rounds: scan, remove the best explanation from the noise, select, refit, prune.
        while len(accepted) < s.max_causes or not first:
            trials: Sequence[Trial] = self._scan(point)
            first = first or tuple(trials)
            if not trials or not s.max_causes:  # no effect left to try
                break
            point, noise, trials, explanations = self._separate_noise_from_causes(point, noise,
                                                                                  trials)
            step = select_effect(self._evidence, point, trials,
                          partial(self.add_effect, self._evidence, noise), s, explanations)
            rejected = step.rejected
            if step.accepted is None:
                break
            one, candidate = step.accepted
            point, noise = self._fit_and_measure_noise(candidate.space, candidate.timing,
                                                       candidate.x)
            point, noise, accepted = self._prune(point, noise, accepted, one)
        # 3. Gains and confounders of each effect, given all the others.
        add_confounders: Callable[[AcceptedEffect], AcceptedEffect] = _keep_confounders
        if len(accepted) > 1 or self._dropped:
            accepted = self._update_gains(point, noise, accepted)
            add_confounders = partial(self._add_confounders, point, noise, self._sweeps)
        if not accepted:
            return SearchResult(given, (base,), base_noise, base_noise, (), rejected, first,
                                add_confounders)
        # 4. Fits with one more effect each, by the noise without the causes.
        effects = [one.effect for one in accepted]
        noise = select_noise(effects, noise, base_noise)
        points = self.fit_nested(base, point, noise, effects)
        return SearchResult(given, points, noise, base_noise, tuple(accepted), rejected, first,
                            add_confounders)

    def fit_nested(self, base: Point, point: Point, noise: Noise, effects: Sequence[str]
              ) -> tuple[Point, ...]:
        """Return the base as it is, and fits with one more effect of a point each.

        Each fit starts from the one before, so that directions without information do not change.
        """
        points = [change_noise(self._evidence, noise, base)]
        for i in range(len(effects)):
            points.append(self.fit_subset(point, noise, effects[:i + 1], points[-1]))
        return (base, *points[1:])

    def fit_subset(self, point: Point, noise: Noise, effects: Sequence[str], start: Point) -> Point:
        """Fit the base with some of the effects of a point, starting from another fit.

        If only effects on readings differ, the Jacobian of that fit is kept.
        """
        p = point.vehicle
        keep = {*effects, *(a.name for a in self.base.effects)}
        vehicle = replace(p, effects=tuple(a for a in p.effects if a.name in keep))
        space = self.make_space(vehicle)
        x = space.transfer(space.start(vehicle, point.timing), start.space, start.x)
        near = refit_reusing_jacobian(self._evidence, noise, space, x, start)
        other = {a.name for a in start.vehicle.effects} ^ {a.name for a in vehicle.effects}
        if all(affects_readings_only(catalogue()[name]) for name in other):
            return near
        return refit(self._evidence, noise, space, near.x, near, jobs=self._settings.jobs)

    def fit_with_nuisance(self, point: Point, noise: Noise, names: Sequence[str]) -> Point:
        """Fit a point with additional effects that may be present and are not reported as causes.

        Two fits: the noise of the first contains the effects and makes them too small.
        """
        has = {a.name for a in point.vehicle.effects}
        vehicle = point.vehicle
        for name in [n for n in names if n not in has]:
            vehicle = apply(vehicle, name)
        if vehicle is point.vehicle:
            return point
        space = self.make_space(vehicle)
        x = space.transfer(space.start(vehicle, point.timing), point.space, point.x)
        first = refit_reusing_jacobian(self._evidence, noise, space, x, point)
        noise = self._measure_training_noise(first.vehicle, first.timing)
        return refit_reusing_jacobian(self._evidence, noise, space, first.x, first)

    def _fit_and_measure_noise(self, space: Space, timing: MessageTiming,
                               x: FloatArray | None = None) -> tuple[Point, Noise]:
        """Fit and measure the noise in turn, until both are consistent.

        With initial coordinates x: until the log volume of the noise decreases by less than
        ``VOLUME_TOLERANCE``.
        """
        initial = x is None
        passes = BASE_NOISE_PASSES if initial else MAX_NOISE_PASSES
        x = self._initial_coordinates(space, timing) if x is None else x
        noise = self._measure_training_noise(*space.split(x))
        point = refit(self._evidence, noise, space, x, jobs=self._settings.jobs)
        for _ in range(passes - 1):
            smaller = self._measure_training_noise(point.vehicle, point.timing)
            if not initial and noise.log_volume - smaller.log_volume < VOLUME_TOLERANCE:
                break
            noise = smaller
            point = refit(self._evidence, noise, space, point.x, point, jobs=self._settings.jobs)
        return point, noise

    def _separate_noise_from_causes(self, point: Point, noise: Noise, trials: Sequence[Trial]
                   ) -> tuple[Point, Noise, Sequence[Trial], Mapping[str, Point]]:
        """Measure the noise without the best explanation, so that no cause is part of the noise.

        1. Fit the trials with the largest gain, and measure the noise at the best of these fits.
        2. If the gain of that fit is much larger by this noise than by the one before, the cause
           was part of the noise: take the new noise, fit the point again, and scan again.
        3. Repeat until the two agree. If no effect is missing, they agree at once.

        Returns the point, the noise, the trials, and the fits of the best trials.
        """
        fits = fit_best_trials(point, trials, partial(self.add_effect, self._evidence, noise))
        for _ in range(MAX_NOISE_SEPARATIONS):
            best = lowest_loss_fit(point, fits.values())
            if best is point:
                break
            sharper = self._measure_training_noise(best.vehicle, best.timing)
            gains = [self._loss(n, point) - self._loss(n, best) for n in (noise, sharper)]
            if gains[1] <= self._settings.policy.naming.min_hidden_ratio * gains[0]:
                break
            noise = sharper
            point = refit(self._evidence, noise, point.space, point.x, point,
                          jobs=self._settings.jobs)
            trials = self._scan(point)
            fits = fit_best_trials(point, trials, partial(self.add_effect, self._evidence, noise))
        return point, noise, trials, fits

    def _loss(self, noise: Noise, point: Point) -> float:
        """Robust loss of the data at a point, weighted by another noise."""
        return loss_at(self._evidence, noise, point.space, point.x)

    def _measure_training_noise(self, vehicle: Vehicle, timing: MessageTiming) -> Noise:
        """Measure the noise of the training evidence."""
        return self.measure_noise(self._evidence, vehicle, timing)

    def measure_noise(self, evidence: Evidence, vehicle: Vehicle, timing: MessageTiming) -> Noise:
        """Measure the noise of the residuals, without the effect of uncertain command times.

        In an own recording the uncertainty is the wait for a PWM frame. In other recordings the
        times are unknown, and a command may change between messages. In an own recording from
        on-board sensors alone, what functions of the driving state predict is subtracted first, see
        ``remove_driven_motion``. Errors of the initial state last for a window there, like errors
        of the model: a noise that contained both would give model errors little weight.
        """
        residuals = evidence.residuals(vehicle, timing)
        stamped = evidence.commands_stamped
        policy = self._settings.policy
        r = remove_driven_motion(evidence, vehicle, residuals) if (
            stamped and not evidence.has_mocap) else residuals
        age_change = age_sensitivity(evidence, vehicle, timing, residuals, policy.noise.age_s)
        return estimate_noise(r, evidence.blocks(), evidence.overlap, age_change, policy.noise,
                              PWM_WAIT_STD if stamped else None)

    def _initial_coordinates(self, space: Space, timing: MessageTiming) -> FloatArray:
        """Coordinates of the base at the best of some command ages.

        The loss has local minima over the age: a fit alone would find the nearest one.
        """
        points = [space.point(MessageTiming(timing.message_age, *ages)) for ages in START_AGES]
        vehicle, _ = space.split(points[0])
        policy = self._settings.policy
        noise = estimate_noise(self._evidence.residuals(vehicle, timing),
                        self._evidence.blocks(), self._evidence.overlap, policy=policy.noise)
        return min(points, key=lambda x: loss_at(self._evidence, noise, space, x))

    def _scan(self, point: Point) -> list[Trial]:
        """Scan all effects at a point; the sweeps are kept for the next round."""
        # Half of the remaining progress per round: the number of rounds is unknown.
        def report_progress(share: float, name: str) -> None:
            if self._progress is not None:
                self._progress(self._done_share + 0.5 * share * (1.0 - self._done_share), name)

        s = self._settings
        trials = scan(self._evidence, point, s.names or None, report_progress, s.jobs,
                      s.policy.scan, self._sweeps)
        self._sweeps = {t.effect: t.sweeps for t in trials}
        self._done_share += 0.5 * (1.0 - self._done_share)
        return [replace(t, sweeps=()) for t in trials]

    def add_effect(self, evidence: Evidence, noise: Noise, point: Point, trial: Trial) -> Point:
        """Fit evidence with one more effect, starting from its trial."""
        vehicle = apply(point.vehicle, trial.effect, **trial.values)
        space = self.make_space(vehicle)
        start = space.start(vehicle, point.timing)
        return refit_extended(evidence, noise, space, start, point,
                              trial.residual.astype(np.float64))

    def remove_effect(self, evidence: Evidence, noise: Noise, point: Point, name: str) -> Point:
        """Fit evidence without an effect, starting from a fit with it."""
        vehicle = remove_effects(point.vehicle, [name])
        space = self.make_space(vehicle)
        return refit_reusing_jacobian(evidence, noise, space, space.start(vehicle, point.timing),
                                      point)

    def make_space(self, vehicle: Vehicle, further: Sequence[str] = ()) -> Space:
        """Make the space around the base, with the effects of a vehicle at their null.

        further: parameters that are free in addition.

        Without a refit the effects of the base keep their values, like its parameters: a free rate
        limit of the model could grow until it replaces a missing lag. The offsets of a fitted
        marker frame are free nevertheless.
        """
        s = self._settings
        fixed = () if s.refit else list_fixed_effects(self.base, s.known)
        return Space(add_null_effects(self.base, vehicle.effects), (*s.free, *further), s.known,
                     self._evidence.message_age, s.policy.prior, self._freed, fixed, s.joint)

    def linearise_stated(self, evidence: Evidence, point: Point) -> StatedParameters:
        """Linearise a fit in the parameters that keep the values of the file."""
        s = self._settings
        names = tuple(s.stated)
        space = Space(point.vehicle, names, s.stated, evidence.message_age, s.policy.prior,
                      fixed_effects=effect_names(point.vehicle), joint=s.stated_together)
        n = len(names)
        if not n:
            return StatedParameters(np.zeros((len(point.residual), 0)), np.zeros((0, 0)))
        moved = evaluate_point(evidence, point.noise, space, space.point(point.timing))
        return StatedParameters(moved.jacobian[:, :n], space.prior_precision[:n, :n])

    def _prune(self, point: Point, noise: Noise, previous: list[AcceptedEffect], new: AcceptedEffect
                ) -> tuple[Point, Noise, list[AcceptedEffect]]:
        """Add a new effect, and drop those that it makes redundant."""
        accepted = [*previous, new]
        for one in previous:
            parameters = [f"{one.effect}.{q.name}" for q in catalogue()[one.effect].parameters]
            limit = CERTAIN_RATIO * one.threshold
            if point.wald_statistic(parameters) > limit:
                continue
            without = self.remove_effect(self._evidence, noise, point, one.effect)
            candidate = Candidate(threshold=one.threshold,
                                  remaining_gain=without.loss() - point.loss())
            if explain_failure("search", candidate, self._settings.policy):
                point, noise = self._fit_and_measure_noise(without.space, without.timing, without.x)
                accepted = [replace(n, alternatives=(*n.alternatives, one.effect)) for n in accepted
                         if n.effect != one.effect]
                self._dropped = True
        return point, noise, accepted

    def _update_gains(self, point: Point, noise: Noise,
                      accepted: list[AcceptedEffect]) -> list[AcceptedEffect]:
        """Compute the gain of each effect given all the others; largest first."""
        found = each(partial(self._update_gain, point, noise), accepted, self._settings.jobs)
        return sorted(found, key=lambda n: (-n.gain, n.effect))

    def _update_gain(self, point: Point, noise: Noise, one: AcceptedEffect) -> AcceptedEffect:
        """Compute the gain of an effect given all the others, if it has alternatives."""
        if not one.alternatives:
            return one
        other = self.remove_effect(self._evidence, noise, point, one.effect)
        return replace(one, gain=other.loss() - point.loss())

    def _add_confounders(self, point: Point, noise: Noise, sweeps: Sweeps,
                         one: AcceptedEffect) -> AcceptedEffect:
        """Find the confounders of an effect, given all the others."""
        if not one.alternatives:
            return one
        without = self.remove_effect(self._evidence, noise, point, one.effect)
        policy = self._settings.policy
        trials = scan(self._evidence, without, (one.effect, *one.alternatives), policy=policy.scan,
                      previous=sweeps)
        own_trial = next(t for t in trials if t.effect == one.effect)
        close = select_correlated(without, own_trial, trials, policy.confounders)
        fits = {t.effect: self.add_effect(self._evidence, noise, without, t) for t in close}
        rows = label_point_rows(self._evidence, without)
        return replace(one, confounders=find_confounders(
            without, own_trial, trials, rows, fits, policy.confounders))

    def __getstate__(self) -> dict[str, Any]:
        """State for a worker process: without callbacks and sweeps."""
        return {**self.__dict__, "_progress": None, "_on_base_fitted": None, "_sweeps": None}


def effect_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the effects of a vehicle."""
    return tuple(a.name for a in vehicle.effects)


def list_fixed_effects(vehicle: Vehicle, known: Mapping[str, float]) -> tuple[str, ...]:
    """List the effects of a base that keep their values: those without a stated standard error."""
    return tuple(n for n in effect_names(vehicle) if not any(k.startswith(f"{n}.") for k in known))


def _keep_confounders(one: AcceptedEffect) -> AcceptedEffect:
    """Return an effect that was accepted alone: its round has found the confounders."""
    return one
