"""Forward search: the effect that explains most, a full refit, again, and once back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.timing import PWM_WAIT_STD
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import apply, catalogue, remove_effects, with_nulls
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.ages import START_AGES, age_sensitivity
from ..evidence.noise import Noise, estimate_noise
from ..evidence.residuals import Evidence, affects_readings_only
from ..evidence.space import MessageTiming, Space
from ..gates import Candidate, explain_failure
from ..unexplained.driven import undriven
from .confounders import confounders, correlated
from .fit import Point, loss_at, refit, refit_near, refit_with, seen_by
from .scan import Line, Progress, Trial, scan
from .selection import (
    Named,
    Rejected,
    Settings,
    explain,
    least_lossy,
    rows_at,
    select,
)

Before = Mapping[str, Sequence[Line]]
PASSES = 2  # the second with the sizes of the residuals of the first


@dataclass(frozen=True, slots=True)
class SearchResult:
    """What a search has found.

    given: the model as it is, at the timing that suits it best. points: the fitted
    base, and with one effect more each. ranking: trials of the first round.

    noise: that of the residuals of the last point, from which the causes are taken. A cause that is
    part of the noise has little weight in the very directions in which it shows, and what is left
    for its size is where the noise happens to cancel it: it is found too small. base_noise: that of
    the residuals of the base.

    alike: a name with what it cannot be told from beside all others that were found.
    """

    given: Point
    points: tuple[Point, ...]
    noise: Noise
    base_noise: Noise
    named: tuple[Named, ...]
    rejected: tuple[Rejected, ...]
    ranking: tuple[Trial, ...]
    alike: Callable[[Named], Named]

    @property
    def refit_loss(self) -> float:
        """By how much the fit of the base lowered the loss."""
        return self.given.loss() - self.base.loss()

    @property
    def base(self) -> Point:
        return self.points[0]

    @property
    def point(self) -> Point:
        """With all effects that were named."""
        return self.points[-1]


def select_noise(effects: Sequence[str], noise: Noise, base_noise: Noise) -> Noise:
    """Select the noise of some effects: the motion of the base if all change readings alone.

    Such effects are no part of the noise of the motion. Each measuring of it moves the base on, and
    a cause in a sensor would move the car.
    """
    if all(affects_readings_only(catalogue()[name]) for name in effects):
        return noise.with_motion(base_noise)
    return noise


class Search:
    """One search on the training evidence."""

    def __init__(self, evidence: Evidence, base: Vehicle, settings: Settings,
                 progress: Progress | None = None,
                 fitted: Callable[[], None] | None = None) -> None:
        """fitted: told when the base is."""
        self._evidence, self._settings, self._progress = evidence, settings, progress
        self._fitted = fitted
        self.base = base
        self._done, self._dropped = 0.0, False
        self._before: Before = {}
        self._loose: tuple[str, ...] = ()

    def run(self) -> SearchResult:
        """Search until nothing passes; in a run of our own again, where the answer is strained.

        A name is for what parameters within their stated errors cannot explain. If beside it, or
        where nothing is named, one still stands on the bound of them, those errors were too small,
        and the name, or the structure that is left, may be what the bound leaves over: such
        parameters are let go, and all is asked anew.
        """
        found = self._searched()
        while self._evidence.commands_stamped and (more := self._strained(found.point)):
            self._loose += more
            self._before, self._dropped = {}, False
            found = self._searched()
        return found

    def _strained(self, point: Point) -> tuple[str, ...]:
        """Parameters on the bound of what is believed of them."""
        return point.space.names_at_bound(point.x, self._settings.policy.prior.believed)

    def _searched(self) -> SearchResult:
        s = self._settings
        space = self.make_space(self.base)
        point, noise = self._settle(space, MessageTiming(self._evidence.message_age))
        if self._fitted is not None:
            self._fitted()
        fixed = Space(self.base, (), message_age=self._evidence.message_age, policy=s.policy.prior,
                      fixed_effects=effect_names(self.base))
        given = refit(self._evidence, noise, fixed, fixed.point(point.timing))
        base, base_noise, first = point, noise, tuple[Trial, ...]()
        named, rejected = list[Named](), tuple[Rejected, ...]()
        while len(named) < s.max_causes or not first:
            trials: Sequence[Trial] = self._scan(point)
            first = first or tuple(trials)
            if not trials or not s.max_causes:  # all that may be named is named
                break
            point, noise, trials, explanations = self._sharpened(point, noise, trials)
            step = select(self._evidence, point, trials,
                          partial(self.add_effect, self._evidence, noise), s, explanations)
            rejected = step.rejected
            if step.accepted is None:
                break
            one, candidate = step.accepted
            point, noise = self._settle(candidate.space, candidate.timing, candidate.x)
            point, noise, named = self._pruned(point, noise, named, one)
        alike: Callable[[Named], Named] = _as_it_is
        if len(named) > 1 or self._dropped:
            named = self._weighed(point, noise, named)
            alike = partial(self._alike, point, noise, self._before)
        if not named:
            return SearchResult(given, (base,), base_noise, base_noise, (), rejected, first, alike)
        effects = [one.effect for one in named]
        noise = select_noise(effects, noise, base_noise)
        points = self.steps(base, point, noise, effects)
        return SearchResult(given, points, noise, base_noise, tuple(named), rejected, first, alike)

    def steps(self, base: Point, point: Point, noise: Noise, effects: Sequence[str]
              ) -> tuple[Point, ...]:
        """The base, and with one effect more each, as they are at a point; each fitted anew.

        Each from the one before: along what the data hardly tell nothing moves.
        """
        points = [seen_by(self._evidence, noise, base)]
        for i in range(len(effects)):
            points.append(self.fit(point, noise, effects[:i + 1], points[-1]))
        return (base, *points[1:])

    def fit(self, point: Point, noise: Noise, effects: Sequence[str], start: Point) -> Point:
        """The base with some of the effects of a point, fitted anew from another one nearby.

        What differs only in what sensors read has the slopes of that one.
        """
        p, keep = point.vehicle, {*effects, *(a.name for a in self.base.effects)}
        vehicle = replace(p, effects=tuple(a for a in p.effects if a.name in keep))
        space = self.make_space(vehicle)
        x = space.transfer(space.start(vehicle, point.timing), start.space, start.x)
        near = refit_near(self._evidence, noise, space, x, start)
        other = {a.name for a in start.vehicle.effects} ^ {a.name for a in vehicle.effects}
        if all(affects_readings_only(catalogue()[name]) for name in other):
            return near
        return refit(self._evidence, noise, space, near.x, near, jobs=self._settings.jobs)

    def beside(self, point: Point, noise: Noise, names: Sequence[str]) -> Point:
        """A point with effects that may be there and are no causes.

        Fitted twice: what an IMU shows askew is noise to the first, and holds it short.
        """
        has, vehicle = {a.name for a in point.vehicle.effects}, point.vehicle
        for name in [n for n in names if n not in has]:
            vehicle = apply(vehicle, name)
        if vehicle is point.vehicle:
            return point
        space = self.make_space(vehicle)
        x = space.transfer(space.start(vehicle, point.timing), point.space, point.x)
        first = refit_near(self._evidence, noise, space, x, point)
        noise = self._measured(first.vehicle, first.timing)
        return refit_near(self._evidence, noise, space, first.x, first)

    def _settle(self, space: Space, timing: MessageTiming,
                x: FloatArray | None = None) -> tuple[Point, Noise]:
        """Fit and measure the residuals, until both suit each other.

        From a fit on (x): until the residuals are no smaller than the noise that weighed them.
        """
        begun, policy = x is None, self._settings.policy.noise
        passes = PASSES if begun else policy.passes
        x = self._start(space, timing) if x is None else x
        noise = self._measured(*space.split(x))
        point = refit(self._evidence, noise, space, x, jobs=self._settings.jobs)
        for _ in range(passes - 1):
            smaller = self._measured(point.vehicle, point.timing)
            if not begun and noise.log_volume - smaller.log_volume < policy.settled:
                break
            noise = smaller
            point = refit(self._evidence, noise, space, point.x, point, jobs=self._settings.jobs)
        return point, noise

    def _sharpened(self, point: Point, noise: Noise, trials: Sequence[Trial]
                   ) -> tuple[Point, Noise, Sequence[Trial], Mapping[str, Point]]:
        """A point and its trials with a noise that has no cause in it, and the best explanations.

        1. Fit the trials that gain most, and measure the noise at the best of these fits.
        2. Where that fit gains much more by this noise than by the one before, the cause was in the
           noise: take the new one, fit the point again, and try all effects again.
        3. Repeat until the two agree. Where nothing is missing they do at once.
        """
        policy = self._settings.policy.naming
        fits = explain(point, trials, partial(self.add_effect, self._evidence, noise), policy)
        for _ in range(policy.sharpenings):
            best = least_lossy(point, fits.values())
            if best is point:
                break
            sharper = self._measured(best.vehicle, best.timing)
            gains = [self._loss(n, point) - self._loss(n, best) for n in (noise, sharper)]
            if gains[1] <= policy.hidden * gains[0]:
                break
            noise = sharper
            point = refit(self._evidence, noise, point.space, point.x, point,
                          jobs=self._settings.jobs)
            trials = self._scan(point)
            fits = explain(point, trials, partial(self.add_effect, self._evidence, noise), policy)
        return point, noise, trials, fits

    def _loss(self, noise: Noise, point: Point) -> float:
        """Robust loss of the data at a point, as another noise weighs them."""
        return loss_at(self._evidence, noise, point.space, point.x)

    def _measured(self, vehicle: Vehicle, timing: MessageTiming) -> Noise:
        return self.measure_noise(self._evidence, vehicle, timing)

    def measure_noise(self, evidence: Evidence, vehicle: Vehicle, timing: MessageTiming) -> Noise:
        """Measure the residuals of a vehicle, without what commands do at a time of their own.

        In a run of our own that is the wait for a frame. Elsewhere nobody knows when, and some
        change between messages. In a run from on-board sensors alone, neither is noise what goes
        with the driving: the state at a start has errors that last for a window, as those of the
        model do, and once taken for such a one an error of the model would count for nothing.
        """
        seen = evidence.residuals(vehicle, timing)
        stamped, policy = evidence.commands_stamped, self._settings.policy
        r = undriven(evidence, vehicle, seen, policy.unexplained) if (
            stamped and not evidence.has_mocap) else seen
        moved = age_sensitivity(evidence, vehicle, timing, seen, policy.noise.age_s)
        return estimate_noise(r, evidence.blocks(policy.blocks.seconds), evidence.overlap, moved,
                       policy.noise, PWM_WAIT_STD if stamped else None)

    def _start(self, space: Space, timing: MessageTiming) -> FloatArray:
        """The base at the best of some ages of commands: in steps by chance a fit finds the
        nearest that suits it, not the best."""
        points = [space.point(MessageTiming(timing.message_age, *ages)) for ages in START_AGES]
        vehicle, _ = space.split(points[0])
        policy = self._settings.policy
        noise = estimate_noise(self._evidence.residuals(vehicle, timing),
                        self._evidence.blocks(policy.blocks.seconds), self._evidence.overlap,
                        policy=policy.noise)
        return min(points, key=lambda x: loss_at(self._evidence, noise, space, x))

    def _scan(self, point: Point) -> list[Trial]:
        def tell(share: float, name: str) -> None:
            if self._progress is not None:
                self._progress(self._done + 0.5 * share * (1.0 - self._done), name)

        s = self._settings
        trials = scan(self._evidence, point, s.names or None, tell, s.jobs, s.policy.scan,
                      self._before)
        self._before = {t.effect: t.lines for t in trials}
        self._done += 0.5 * (1.0 - self._done)
        return [replace(t, lines=()) for t in trials]

    def add_effect(self, evidence: Evidence, noise: Noise, point: Point, trial: Trial) -> Point:
        """Fit evidence with one more effect, from its trial on."""
        vehicle = apply(point.vehicle, trial.effect, **trial.values)
        space = self.make_space(vehicle)
        start = space.start(vehicle, point.timing)
        return refit_with(evidence, noise, space, start, point, trial.residual.astype(np.float64))

    def remove_effect(self, evidence: Evidence, noise: Noise, point: Point, name: str) -> Point:
        """Fit evidence without an effect, from a fit with it on."""
        vehicle = remove_effects(point.vehicle, [name])
        space = self.make_space(vehicle)
        return refit_near(evidence, noise, space, space.start(vehicle, point.timing), point)

    def make_space(self, vehicle: Vehicle) -> Space:
        """Around the base, with the effects of a vehicle at their null.

        Without a refit the effects that the base has keep their values, like its parameters: a
        rate limit of the model that is free stretches until it takes the place of a missing lag.
        The offsets of a fitted marker frame are free all the same.
        """
        s = self._settings
        fixed = () if s.refit else list_fixed_effects(self.base, s.known)
        return Space(with_nulls(self.base, vehicle.effects), s.free, s.known,
                     self._evidence.message_age, s.policy.prior, self._loose, fixed)

    def _pruned(self, point: Point, noise: Noise, before: list[Named], new: Named
                ) -> tuple[Point, Noise, list[Named]]:
        """Add a new one, drop what it has made superfluous."""
        named = [*before, new]
        for one in before:
            mine = [f"{one.effect}.{q.name}" for q in catalogue()[one.effect].parameters]
            if point.wald(mine) > self._settings.policy.naming.sure * one.threshold:
                continue
            without = self.remove_effect(self._evidence, noise, point, one.effect)
            candidate = Candidate(threshold=one.threshold,
                                  remaining_gain=without.loss() - point.loss())
            if explain_failure("search", candidate, self._settings.policy):
                point, noise = self._settle(without.space, without.timing, without.x)
                named = [replace(n, alternatives=(*n.alternatives, one.effect)) for n in named
                         if n.effect != one.effect]
                self._dropped = True
        return point, noise, named

    def _weighed(self, point: Point, noise: Noise, named: list[Named]) -> list[Named]:
        """Each with what it gains beside all the others that were found, the largest first."""
        found = each(partial(self._weigh, point, noise), named, self._settings.jobs)
        return sorted(found, key=lambda n: (-n.gain, n.effect))

    def _weigh(self, point: Point, noise: Noise, one: Named) -> Named:
        if not one.alternatives:
            return one
        other = self.remove_effect(self._evidence, noise, point, one.effect)
        return replace(one, gain=other.loss() - point.loss())

    def _alike(self, point: Point, noise: Noise, before: Before, one: Named) -> Named:
        if not one.alternatives:
            return one
        without = self.remove_effect(self._evidence, noise, point, one.effect)
        policy = self._settings.policy
        trials = scan(self._evidence, without, (one.effect, *one.alternatives), policy=policy.scan,
                      before=before)
        mine = next(t for t in trials if t.effect == one.effect)
        close = correlated(without, mine, trials, policy.confounders)
        fits = {t.effect: self.add_effect(self._evidence, noise, without, t) for t in close}
        rows = rows_at(self._evidence, without, policy)
        return replace(one, confounders=confounders(
            without, mine, trials, rows, fits, policy.confounders))

    def __getstate__(self) -> dict[str, Any]:
        """For another process, which cannot show progress here."""
        return {**self.__dict__, "_progress": None, "_fitted": None, "_before": None}


def effect_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the effects that a vehicle has."""
    return tuple(a.name for a in vehicle.effects)


def list_fixed_effects(vehicle: Vehicle, known: Mapping[str, float]) -> tuple[str, ...]:
    """List the effects of a base that keep their values: those without a stated standard error."""
    return tuple(n for n in effect_names(vehicle) if not any(k.startswith(f"{n}.") for k in known))


def _as_it_is(one: Named) -> Named:
    """A name that was found alone: its round has told what it is alike."""
    return one
