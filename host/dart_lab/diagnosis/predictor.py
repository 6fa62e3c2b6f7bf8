"""Find the best predictor: the effects that lower errors on held-out recordings.

A cause is accepted where held-out data support it. A model that only has to predict may include
more: every effect that lowers errors on recordings to which its size was not fitted. It minimises L
of ``final_fit`` over held-out recordings, by fits in which every recording has the same weight.

1. Start from the accepted effects. Add all others that lower the loss by more than chance does, and
   fit them together.
2. Drop effects that the fit does not need.
3. Fit without each recording in turn, and compute L. Drop the effect whose size no car has, else
   the one that the fit needs least. Repeat until one effect is left, or L is 0.1 above the smallest
   one. Compute L of the refit without effects; from six recordings on it is the reported one.
4. Take the effects with the smallest L. With fewer than six recordings fit them by the noise as
   well, as the search does, and keep the fit with the smaller L.
5. If the 90 % interval of its errors over those of the refit, by recordings, does not lie below 1,
   the refit is the best predictor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import apply, catalogue, remove_effects
from dart_hal.vehicle.flat import unit, value
from dart_lab.identification.evaluation.cases import Case
from dart_lab.identification.evidence.residuals import Evidence, affects_readings_only
from dart_lab.identification.objective import Point

from .error_summaries import HeldOutError
from .final_fit import CrossValidatedFit, EqualFits
from .gains import RecordingSet
from .grade.accept import impossible_size
from .result import BestPredictor, ParameterEstimate, estimate_effects
from .search.forward import effect_names
from .search.scan import scan

MIN_RECORDINGS = 3  # with two, each effect would be judged by a fit to a single recording
# Iterations of the fit with all effects between measurements of the weights. It only decides which
# effects are dropped first: with more it takes twice as long, and errors are no smaller.
WIDE_ITERATIONS = 4
# Drop of the loss by an effect alone, above which it is tried: twice the 2.7 that 10 % of useless
# effects exceed, because a size is the best of several.
MIN_LOSS_DROP = 5.0
# Rise of the loss without an effect, to second order, up to which it is dropped: what one useless
# parameter lowers the loss by on average.
MAX_NEEDLESS_RISE = 1.0
# Rise of L above its smallest value, from which on no fewer effects are tried:
# errors are 10 % larger, and with fewer effects they hardly become smaller again.
MAX_CRITERION_RISE = 0.1
# Effects that do not apply to other recordings, where battery and slope differ.
#
# With another centre of mass, the motion of another point would be compared.
NOT_TRANSFERABLE = ("battery_fade", "centre_of_mass", "road_slope_x", "road_slope_y")


def check_recordings(train: RecordingSet) -> Sequence[Case]:
    """Return the recordings that a predictor can be judged by.

    Raises UsageError with fewer than three training recordings with motion capture.
    """
    cases = train.prepared.cases if train.prepared else ()
    if len(cases) < MIN_RECORDINGS:
        raise UsageError("too few recordings to find a predictor",
                         found=f"{len(cases)} training recording(s) with motion capture",
                         expected=f"at least {MIN_RECORDINGS}: each is predicted by a fit to the "
                                  "others",
                         remedy="give more recordings to --train, or leave out --out-predictor")
    return cases


def find_predictor(fits: EqualFits, train: RecordingSet, test: RecordingSet, base: Point,
                   accepted: Point) -> BestPredictor:
    """Find the effects that lower errors on held-out training recordings.

    fits: to the training recordings; base: the refit of the search; accepted: the fit with the
    accepted effects. The test recordings are predicted at the end and select nothing.

    Raises UsageError with fewer than three training recordings with motion capture.
    """
    check_recordings(train)
    work = _PredictorSearch(fits, frozenset(effect_names(fits.search.base)))

    # 1. add all effects on the motion that lower the loss in addition to the accepted ones
    read = tuple(a for a in accepted.vehicle.effects if affects_readings_only(a.effect))
    wide = remove_effects(accepted.vehicle, [a.name for a in read])
    for name in work.candidates(train.evidence, accepted):
        wide = apply(wide, name)
    fit = fits.fit_first(wide, accepted, WIDE_ITERATIONS)
    # 2. drop those that are not needed in this fit
    needless = [name for name, rise in work.rises(fit).items() if rise < MAX_NEEDLESS_RISE]
    if needless:
        fit = fits.fit(remove_effects(fit.vehicle, needless), fit)
    # 3. drop one effect at a time; a fit from one with effects may end at another minimum
    unchanged = remove_effects(base.vehicle, [a.name for a in read])
    none = fits.judge(fits.fit_first(unchanged, base))
    tried = [*work.drop_in_turn(fit), none]
    # 4. take the smallest error; of few recordings also by the noise
    refitted = fits.select(none)
    if not fits.weighs_equally:
        tried.append(fits.judge(fits.fit_by_noise(work.smallest(tried).fit)))
    # 5. take the refit if the interval includes 1
    best = work.smallest(tried)
    if best.relative_to(refitted).high >= 1.0:
        best = refitted
    return work.result(best, refitted, tried, test, read)


@dataclass(frozen=True, slots=True)
class _PredictorSearch:
    """Steps of ``find_predictor``; given: effects of the given model, which are never dropped."""

    fits: EqualFits
    given: frozenset[str]

    def found(self, fit: Point) -> tuple[str, ...]:
        """Return the effects on the motion that the given model does not have."""
        return tuple(n for n in effect_names(fit.vehicle)
                     if n not in self.given and _moves_car(n))

    def candidates(self, evidence: Evidence, fit: Point) -> list[str]:
        """Return effects on the motion that each lower the loss by more than chance does."""
        has = effect_names(fit.vehicle)
        names = [n for n in catalogue() if _moves_car(n) and n not in has]
        return [trial.effect for trial in scan(evidence, fit, names, jobs=self.fits.jobs)
                if trial.gain > MIN_LOSS_DROP]

    def rises(self, fit: Point) -> dict[str, float]:
        """Return the rise of the loss without each effect that was found, to second order."""
        return {name: fit.wald_statistic([f"{name}.{q.name}" for q in catalogue()[name].parameters])
                for name in self.found(fit)}

    def drop_in_turn(self, fit: Point) -> list[CrossValidatedFit]:
        """Return the fit, and those after each effect that is dropped, down to one effect."""
        tried = [self.fits.judge(fit)] if self.found(fit) else []
        while len(rises := self.rises(fit)) > 1 and tried[-1].criterion <= MAX_CRITERION_RISE + min(
                one.criterion for one in tried):
            least = min(rises, key=lambda name: (not impossible_size(fit, name), rises[name], name))
            fit = self.fits.fit(remove_effects(fit.vehicle, [least]), fit)
            tried.append(self.fits.judge(fit))
        return tried

    def smallest(self, tried: Sequence[CrossValidatedFit]) -> CrossValidatedFit:
        """Return the fit with the smallest L whose effects all have sizes that a car can have."""
        possible = [one for one in tried
                    if not any(impossible_size(one.fit, name) for name in self.found(one.fit))]
        return min(possible, key=lambda one: one.criterion)

    def result(self, best: CrossValidatedFit, refitted: CrossValidatedFit,
               tried: Sequence[CrossValidatedFit], test: RecordingSet,
               read: Sequence[ActiveEffect]) -> BestPredictor:
        """Return the best predictor; read: accepted effects that only sensors show."""
        vehicle = self.fits.vehicle_for_log(best.fit)
        stds = self._jackknife(best)
        effects = estimate_effects(vehicle, self.found(best.fit), stds)
        numbers = {n: ParameterEstimate(value(vehicle, n), std, unit(vehicle, n))
                   for n, std in stds.items() if n.partition(".")[0] not in effects}
        left_out = {fold.case.file: HeldOutError(tuple(base), tuple(changed))
                    for fold, base, changed in zip(self.fits.folds, refitted.errors.tolist(),
                                                   best.errors.tolist(), strict=True)}
        sets = tuple((self.found(one.fit), one.relative_to(refitted)) for one in tried)
        return BestPredictor(replace(vehicle, effects=(*vehicle.effects, *read)), effects, numbers,
                             left_out, sets, test.horizons(vehicle))

    def _jackknife(self, best: CrossValidatedFit) -> dict[str, float]:
        """Return the standard error of each number by the fits without one recording each."""
        vehicles = [self.fits.vehicle_for_log(replace(best.fit, x=x)) for x in best.fold_points]
        return {n: math.sqrt((len(vehicles) - 1) * float(np.var([value(v, n) for v in vehicles])))
                for n in best.fit.space.names}


def _moves_car(effect: str) -> bool:
    """Return whether an effect belongs to the car and changes its motion, not a measurement."""
    return catalogue()[effect].stage != "measurement" and effect not in NOT_TRANSFERABLE
