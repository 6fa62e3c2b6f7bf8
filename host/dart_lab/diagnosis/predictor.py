"""Find the best predictor: the effects that lower errors on recordings left out of the fit.

A cause is accepted where data left out of its size support it. A model that only has to predict may
take more: every effect that helps on recordings which its sizes were not fitted to. It minimises L
of ``final_fit``, over recordings left out of fits in which every recording has the same weight.

1. Start from the accepted effects. Add all others that lower the loss by more than chance does, and
   fit them together.
2. Drop what the fit does not need.
3. Fit without each recording in turn, and compute L. Drop the effect whose size no car has, else
   the one that the fit needs least. Repeat until no effect on the motion is left.
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

from .error_summaries import LeftOutError
from .evidence.residuals import Evidence, affects_readings_only
from .final_fit import FIRST_PASSES, EqualFits, JudgedFit
from .gains import Side
from .grade.accept import impossible_size
from .result import BestPredictor, Number
from .search.fit import Point
from .search.forward import effect_names
from .search.scan import scan

LEAST_RECORDINGS = 3
"""With two, each effect would be judged by a fit to a single recording."""
LEAST_GAIN = 5.0
"""Loss that an effect must gain alone: twice the 2.7 that 10 % of useless effects exceed, as its
size is the best of several that are tried."""
NEEDLESS = 1.0
"""Rise of the loss without an effect, to second order: what one useless parameter gains."""
NOT_TRANSFERABLE = ("battery_fade", "centre_of_mass", "road_slope_x", "road_slope_y")
"""Effects that predict no other recording: a battery fades and a floor slopes differently there.
Another centre of mass would be another point whose motion is compared."""


def check_recordings(train: Side) -> Sequence[Case]:
    """Return the recordings that a predictor can be judged by.

    Raises UsageError with fewer than three training recordings with motion capture.
    """
    cases = train.prepared.cases if train.prepared else ()
    if len(cases) < LEAST_RECORDINGS:
        raise UsageError("too few recordings to find a predictor",
                         found=f"{len(cases)} training recording(s) with motion capture",
                         expected=f"at least {LEAST_RECORDINGS}: each is predicted by a fit to the "
                                  "others",
                         remedy="give more recordings to --train, or leave out --out-predictor")
    return cases


def find_predictor(fits: EqualFits, train: Side, test: Side, accepted: Point) -> BestPredictor:
    """Find the effects that lower errors on training recordings left out of the fit.

    fits: to the training recordings; accepted: the fit with the accepted effects. The test
    recordings are predicted at the end and select nothing.

    Raises UsageError with fewer than three training recordings with motion capture.
    """
    check_recordings(train)
    work = _PredictorSearch(fits, frozenset(effect_names(fits.search.base)))

    # 1. with all effects on the motion that gain anything beside the accepted ones
    read = tuple(a for a in accepted.vehicle.effects if affects_readings_only(a.effect))
    wide = remove_effects(accepted.vehicle, [a.name for a in read])
    for name in work.gainful(train.evidence, accepted):
        wide = apply(wide, name)
    fit = fits.fit(wide, accepted, FIRST_PASSES)
    # 2. without those that do nothing then
    needless = [name for name, rise in work.rises(fit).items() if rise < NEEDLESS]
    if needless:
        fit = fits.fit(remove_effects(fit.vehicle, needless), fit)
    # 3. one effect less each time
    tried = [fits.judge(fit)]
    while rises := work.rises(fit):
        least = min(rises, key=lambda name: (not impossible_size(fit, name), rises[name], name))
        fit = fits.fit(remove_effects(fit.vehicle, [least]), fit)
        tried.append(fits.judge(fit))
    # 4. the smallest error; of few recordings by the noise as well
    refitted = fits.select(tried[-1])
    if not fits.weighs_equally:
        tried.append(fits.judge(fits.fit_by_noise(work.smallest(tried).fit)))
    # 5. the refit where the interval includes 1
    best = work.smallest(tried)
    if best.relative_to(refitted).high >= 1.0:
        best = refitted
    return work.result(best, refitted, tried, test, read)


@dataclass(frozen=True, slots=True)
class _PredictorSearch:
    """given: effects of the model as it was given, which stay."""

    fits: EqualFits
    given: frozenset[str]

    def found(self, fit: Point) -> tuple[str, ...]:
        """Names of the effects on the motion that the given model does not have."""
        return tuple(n for n in effect_names(fit.vehicle)
                     if n not in self.given and _moves_car(n))

    def gainful(self, evidence: Evidence, fit: Point) -> list[str]:
        """Effects on the motion that lower the loss by more than chance does, each by itself."""
        has = effect_names(fit.vehicle)
        names = [n for n in catalogue() if _moves_car(n) and n not in has]
        return [trial.effect for trial in scan(evidence, fit, names, jobs=self.fits.jobs)
                if trial.gain > LEAST_GAIN]

    def rises(self, fit: Point) -> dict[str, float]:
        """Rise of the loss without each effect that was found, to second order."""
        return {name: fit.wald_statistic([f"{name}.{q.name}" for q in catalogue()[name].parameters])
                for name in self.found(fit)}

    def smallest(self, tried: Sequence[JudgedFit]) -> JudgedFit:
        """The one with the smallest L of those whose effects all have sizes that a car can have."""
        possible = [one for one in tried
                    if not any(impossible_size(one.fit, name) for name in self.found(one.fit))]
        return min(possible, key=lambda one: one.criterion)

    def result(self, best: JudgedFit, refitted: JudgedFit, tried: Sequence[JudgedFit],
               test: Side, read: Sequence[ActiveEffect]) -> BestPredictor:
        """read: accepted effects on what sensors read, which the fits of the motion leave out."""
        vehicle, stds = self.fits.as_logged(best.fit), self._jackknife(best)
        effects = {a.name: {q.name: Number(value(vehicle, f"{a.name}.{q.name}"),
                                           stds[f"{a.name}.{q.name}"], q.unit, q.null)
                            for q in a.effect.parameters}
                   for a in vehicle.effects if a.name in self.found(best.fit)}
        numbers = {n: Number(value(vehicle, n), std, unit(vehicle, n))
                   for n, std in stds.items() if n.partition(".")[0] not in effects}
        left_out = {fold.case.file: LeftOutError(tuple(before), tuple(after))
                    for fold, before, after in zip(self.fits.folds, refitted.errors.tolist(),
                                                   best.errors.tolist(), strict=True)}
        sets = tuple((self.found(one.fit), one.relative_to(refitted)) for one in tried)
        return BestPredictor(replace(vehicle, effects=(*vehicle.effects, *read)), effects, numbers,
                             left_out, sets, test.horizons(vehicle))

    def _jackknife(self, best: JudgedFit) -> dict[str, float]:
        """Standard error of each number: the spread of the fits without one recording each."""
        vehicles = [self.fits.as_logged(replace(best.fit, x=x)) for x in best.left_out]
        return {n: math.sqrt((len(vehicles) - 1) * float(np.var([value(v, n) for v in vehicles])))
                for n in best.fit.space.names}


def _moves_car(effect: str) -> bool:
    """Whether an effect belongs to the car and changes how it moves, not what is measured of it."""
    return catalogue()[effect].stage != "measurement" and effect not in NOT_TRANSFERABLE
