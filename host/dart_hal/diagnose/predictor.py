"""Find the best predictor: the effects that lower errors on recordings left out of the fit.

A cause is accepted where data left out of its size support it. A model that only has to predict may
take more: every effect that helps on recordings which its sizes were not fitted to. Over K
recordings, with s_kc the RMS error 1 s ahead in channel c of recording k, as the fit to the others
predicts it, the best predictor minimises

    L = mean_k mean_c ln s_kc

so every recording has the same weight, however long it is and however well the car can be predicted
in it. Each fit minimises the same over its own recordings. Since d ln s = sum_i e_i de_i / (n s^2),
that is least squares with weights 1 / (n s^2), which are measured again after each fit.

1. Start from the accepted effects. Add all others that lower the loss by more than chance does, and
   fit them together.
2. Drop what the fit does not need.
3. Fit without each recording in turn, and compute L. Drop the effect whose size no car has, else
   the one that the fit needs least. Repeat until no effect on the motion is left.
4. Take the effects with the smallest L. Fit them by the weights of the diagnosis too: these are
   better where the model is complete, and what is left is noise. Keep the fit with the smaller L.
5. If the 90 % interval of its errors over those of the refit, by recordings, does not lie below 1,
   the refit is the best predictor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dart_hal.errors import UsageError
from dart_hal.evaluate.cases import Case
from dart_hal.process.jobs import each
from dart_hal.types import FloatArray
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.flat import unit, value
from dart_hal.vehicle.parameters import Vehicle

from .error_summaries import LeftOutError, Ratio, geometric_mean
from .evidence.drive import READ_OUTS
from .evidence.noise import Noise
from .evidence.residuals import Evidence, only_read
from .evidence.space import Timing
from .gains import AT, Side, compute_case_errors
from .grade.names import impossible_size
from .result import BestPredictor, Number
from .search.fit import Point, refit, refit_near
from .search.forward import Search, effect_names
from .search.scan import scan

LEAST_RECORDINGS = 3
"""With two, each effect would be judged by a fit to a single recording."""
LEAST_GAIN = 5.0
"""Loss that an effect must gain alone: twice the 2.7 that 10 % of useless effects exceed, as its
size is the best of several that are tried."""
NEEDLESS = 1.0
"""Rise of the loss without an effect, to second order: what one useless parameter gains."""
TYPICAL_WINDOWS = 5
"""Windows of an average recording that are added to each recording's mean square. The error of one
with a single window is known by chance only."""
NOT_TRANSFERABLE = ("battery_fade", "centre_of_mass", "road_slope_x", "road_slope_y")
"""Effects that predict no other recording: a battery fades and a floor slopes differently there.
Another centre of mass would be another point whose motion is compared."""
FIRST_PASSES, LATER_PASSES = 3, 2
"""Fits with weights measured again; the later ones start near their end."""


class _Candidate(NamedTuple):
    """A fit of some effects to all recordings.

    errors (K, 5): RMS error 1 s ahead in each recording, by the fit to the others;
    left_out (K, k): where these fits are.
    """

    fit: Point
    errors: FloatArray
    left_out: FloatArray

    @property
    def criterion(self) -> float:
        """L of the module's docstring."""
        return float(np.log(self.errors).mean())

    def relative_to(self, other: _Candidate) -> Ratio:
        """Its errors over those of another, by recording."""
        return geometric_mean(np.exp(np.log(self.errors / other.errors).mean(axis=1)))


@dataclass(frozen=True, slots=True)
class _Fold:
    """One recording left out: the evidence of the others, and the windows of the one."""

    drive: int
    others: Evidence
    case: Case


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


def find_predictor(search: Search, train: Side, test: Side, accepted: Point,
                   as_logged: Callable[[Point], Vehicle], jobs: int = 1) -> BestPredictor:
    """Find the effects that lower errors on training recordings left out of the fit.

    accepted: the fit with the accepted effects; as_logged: the vehicle of a fit, its delays counted
    from the log. The test recordings are predicted at the end and select nothing.

    Raises UsageError with fewer than three training recordings with motion capture.
    """
    cases = check_recordings(train)
    # what an encoder reads of a slipping wheel depends on the drive force: its many messages would
    # decide the motor of a model that is only wrong about the slip
    evidence = train.evidence.motion_alone()
    sha256 = [d.recording.sha256 for d in evidence.drives]
    drives = [sha256.index(case.sha256) for case in cases]
    folds = tuple(_Fold(k, evidence.without(k), case)
                  for k, case in zip(drives, cases, strict=True))
    work = _PredictorSearch(search, evidence, folds, as_logged, accepted.noise,
                            frozenset(effect_names(search.base)), jobs)

    # 1. with all effects on the motion that gain anything beside the accepted ones
    read = tuple(a for a in accepted.vehicle.effects if only_read(a.effect))
    wide = _without(accepted.vehicle, [a.name for a in read])
    for name in work.gainful(train.evidence, accepted):
        wide = apply(wide, name)
    fit = work.fit(wide, accepted, FIRST_PASSES)
    # 2. without those that do nothing then
    needless = [name for name, rise in work.rises(fit).items() if rise < NEEDLESS]
    if needless:
        fit = work.fit(_without(fit.vehicle, needless), fit)
    # 3. one effect less each time
    tried = [work.judge(fit)]
    while rises := work.rises(fit):
        least = min(rises, key=lambda name: (not impossible_size(fit, name), rises[name], name))
        fit = work.fit(_without(fit.vehicle, [least]), fit)
        tried.append(work.judge(fit))
    # 4. the smallest error, by either kind of weights
    refitted = work.judge(work.fit_by_noise(fit))
    tried.append(work.judge(work.fit_by_noise(work.smallest(tried).fit)))
    # 5. the refit where the interval includes 1
    best = work.smallest(tried)
    if best.relative_to(refitted).high >= 1.0:
        best = refitted
    return work.result(best, refitted, tried, test, read)


@dataclass(frozen=True, slots=True)
class _PredictorSearch:
    """Fits on the evidence of the motion, and how well they predict what they have not seen.

    noise: gives the weights of windows that overlap; given: effects of the model as it was given,
    which stay.
    """

    search: Search
    evidence: Evidence
    folds: tuple[_Fold, ...]
    as_logged: Callable[[Point], Vehicle]
    noise: Noise
    given: frozenset[str]
    jobs: int

    def found(self, fit: Point) -> tuple[str, ...]:
        """Names of the effects on the motion that the given model does not have."""
        return tuple(n for n in effect_names(fit.vehicle)
                     if n not in self.given and _moves_car(n))

    def gainful(self, evidence: Evidence, fit: Point) -> list[str]:
        """Effects on the motion that lower the loss by more than chance does, each by itself."""
        has = effect_names(fit.vehicle)
        names = [n for n in catalogue() if _moves_car(n) and n not in has]
        return [trial.effect for trial in scan(evidence, fit, names, jobs=self.jobs)
                if trial.gain > LEAST_GAIN]

    def rises(self, fit: Point) -> dict[str, float]:
        """Rise of the loss without each effect that was found, to second order."""
        return {name: fit.wald([f"{name}.{q.name}" for q in catalogue()[name].parameters])
                for name in self.found(fit)}

    def fit(self, vehicle: Vehicle, near: Point, passes: int = LATER_PASSES) -> Point:
        """Fit a vehicle from a fit nearby, weights measured before each pass."""
        space = self.search.make_space(vehicle)
        x = space.carried(space.start(vehicle, near.timing), near.space, near.x)
        for _ in range(passes):
            noise = _weigh_recordings_equally(self.noise, self.evidence, *space.split(x))
            fit = refit(self.evidence, noise, space, x, jobs=self.jobs)
            x = fit.x
        return fit

    def fit_by_noise(self, near: Point) -> Point:
        """Fit the vehicle of a fit nearby by the noise, as the diagnosis does."""
        return refit(self.evidence, self.noise, near.space, near.x, jobs=self.jobs)

    def smallest(self, tried: Sequence[_Candidate]) -> _Candidate:
        """The one with the smallest L of those whose effects all have sizes that a car can have."""
        possible = [one for one in tried
                    if not any(impossible_size(one.fit, name) for name in self.found(one.fit))]
        return min(possible, key=lambda one: one.criterion)

    def judge(self, fit: Point) -> _Candidate:
        """Fit without each recording, and predict it."""
        work = [(fold.others, _rows_of_others(self.evidence, fit, fold.drive))
                for fold in self.folds]
        fits = list(each(_refit_others, work, self.jobs))
        errors = [compute_case_errors(self.as_logged(one), (fold.case,), self.evidence.l_r)[AT]
                  for one, fold in zip(fits, self.folds, strict=True)]
        return _Candidate(fit, np.array([np.sqrt(np.mean(e**2, axis=1)) for e in errors]),
                          np.array([one.x for one in fits]))

    def result(self, best: _Candidate, refitted: _Candidate, tried: Sequence[_Candidate],
               test: Side, read: Sequence[ActiveEffect]) -> BestPredictor:
        """read: accepted effects on what sensors read, which the fits of the motion leave out."""
        vehicle, stds = self.as_logged(best.fit), self._jackknife(best)
        effects = {a.name: {q.name: Number(value(vehicle, f"{a.name}.{q.name}"),
                                           stds[f"{a.name}.{q.name}"], q.unit, q.null)
                            for q in a.effect.parameters}
                   for a in vehicle.effects if a.name in self.found(best.fit)}
        numbers = {n: Number(value(vehicle, n), std, unit(vehicle, n))
                   for n, std in stds.items() if n.partition(".")[0] not in effects}
        left_out = {fold.case.file: LeftOutError(tuple(before), tuple(after))
                    for fold, before, after in zip(self.folds, refitted.errors.tolist(),
                                                   best.errors.tolist(), strict=True)}
        sets = tuple((self.found(one.fit), one.relative_to(refitted)) for one in tried)
        return BestPredictor(replace(vehicle, effects=(*vehicle.effects, *read)), effects, numbers,
                             left_out, sets, test.horizons(vehicle))

    def _jackknife(self, best: _Candidate) -> dict[str, float]:
        """Standard error of each number: the spread of the fits without one recording each."""
        vehicles = [self.as_logged(replace(best.fit, x=x)) for x in best.left_out]
        return {n: math.sqrt((len(vehicles) - 1) * float(np.var([value(v, n) for v in vehicles])))
                for n in best.fit.space.names}


def _moves_car(effect: str) -> bool:
    """Whether an effect belongs to the car and changes how it moves, not what is measured of it."""
    return catalogue()[effect].stage != "measurement" and effect not in NOT_TRANSFERABLE


def _without(vehicle: Vehicle, names: Sequence[str]) -> Vehicle:
    return replace(vehicle, effects=tuple(a for a in vehicle.effects if a.name not in names))


def _weigh_recordings_equally(noise: Noise, evidence: Evidence, vehicle: Vehicle, timing: Timing
                              ) -> Noise:
    """The noise by which the loss of the motion is the sum of ln s_kc, to first order.

    Of residual e_i in read-out and channel c of recording k, with n_k of all N windows:

        e_i / s_c * (s_c / s_kc) * sqrt(N / (K n_k))

    The read-outs of one window err together and count as one.
    """
    motion = np.nan_to_num(evidence.residuals(vehicle, timing).motion, nan=1e3, posinf=1e3,
                           neginf=-1e3)
    drive = evidence.motion_drive
    used = np.unique(drive)
    pooled = np.mean(motion**2, axis=0) + 1e-12
    certain = np.ones(motion.shape)
    for k in used:
        mine = drive == k
        n = int(mine.sum())
        square = (np.sum(motion[mine]**2, axis=0) + TYPICAL_WINDOWS * pooled) / (
            n + TYPICAL_WINDOWS)
        certain[mine] = np.sqrt(pooled / square * len(motion) / (len(used) * n))
    c = len(pooled)
    weight = noise.weight.copy()
    weight[:c] /= len(READ_OUTS)
    return replace(noise, motion=np.diag(1.0 / np.sqrt(pooled)), certain=certain, weight=weight)


def _refit_others(work: tuple[Evidence, Point]) -> Point:
    others, near = work
    return refit_near(others, near.noise, near.space, near.x, near)


def _rows_of_others(evidence: Evidence, fit: Point, drive: int) -> Point:
    """A fit with the rows of all recordings but one."""
    keep = evidence.motion_drive != drive
    certain = np.broadcast_to(fit.noise.certain, (len(keep), len(fit.noise.motion)))
    noise = replace(fit.noise, certain=certain[keep])
    rows = np.concatenate([np.repeat(keep, len(noise.motion)),
                           np.repeat(evidence.sensor_drive != drive, len(noise.sensors))])
    return Point(noise, fit.space, fit.x, fit.residual[rows], fit.weight[rows], fit.jacobian[rows])
