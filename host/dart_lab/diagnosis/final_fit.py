"""Fit the numbers that are reported: of the base, and with one accepted effect more each.

The search weighs errors by their measured covariance. That is best where the model is complete, and
the residuals are noise. In recordings of a real car a large part of the residuals is an error of
the model, different in each kind of driving, and the small errors of slow driving would dominate.

Over K recordings, with s_kc the RMS error 1 s ahead in channel c of recording k, as the fit to the
others predicts it, a fit is judged by

    L = mean_k mean_c ln s_kc

so every recording has the same weight, independent of its length and of how well the car can be
predicted in it. A fit to recordings of equal weight minimises the same over its own recordings.
Since d ln s = sum_i e_i de_i / (n s^2), that is least squares with weights 1 / (n s^2), which are
measured again after each fit. It replaces the weighting by noise from six recordings on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.cases import Case
from dart_lab.identification.evaluation.prediction import HORIZON_OFFSETS
from dart_lab.identification.evidence.drive import READ_OUTS
from dart_lab.identification.evidence.noise import Noise, replace_diverged
from dart_lab.identification.evidence.residuals import Evidence, affects_readings_only
from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.identification.objective import (
    MAX_FIT_ITERATIONS,
    Point,
    refit,
    refit_reusing_jacobian,
)

from .error_summaries import Ratio, geometric_mean
from .gains import HORIZON_INDEX, RecordingSet, compute_case_errors
from .search.forward import ForwardSearch

# Windows of an average recording that are added to the mean square of each recording: that of a
# single window is known by chance only.
TYPICAL_WINDOWS = 5
# Error of an effect's size, as a share of it, where the car has another equation of the effect.
# Derived from 136 effects that were simulated with other equations: 90 % intervals of the sampling
# error alone held 65 % of the sizes, for any estimate of it (sandwich, jackknife, long or short
# blocks); with a share of .05, .08, .10 and .12 they hold 81, 87, 88 and 93 %. Of 137 effects in
# other drives they hold 90 %.
FORM_ERROR = 0.10
FIRST_PASSES = 3  # fits with weights measured again
LATER_PASSES = 2  # the same from a start near the minimum
# Iterations of a fit to all recordings but one, which starts at the fit to all. With 6 the errors
# there are the same within 0.4 %.
FOLD_ITERATIONS = 3


class CrossValidatedFit(NamedTuple):
    """A fit to all recordings, and the errors of such fits in held-out recordings.

    errors (K, 5): RMS error 1 s ahead in each recording, by the fit to the others;
    fold_points (K, k): the points of these fits.
    """

    fit: Point
    errors: FloatArray
    fold_points: FloatArray

    @property
    def criterion(self) -> float:
        """L of the module's docstring."""
        return float(np.log(self.errors).mean())

    def relative_to(self, other: CrossValidatedFit) -> Ratio:
        """Return its errors over those of another fit, geometric mean over recordings."""
        return geometric_mean(np.exp(np.log(self.errors / other.errors).mean(axis=1)))


@dataclass(frozen=True, slots=True)
class _Fold:
    """One held-out recording: the evidence of the others, and the windows of the one."""

    drive: int
    others: Evidence
    case: Case


@dataclass(frozen=True, slots=True)
class EqualFits:
    """Fits of the motion in which every recording has the same weight, see ``make_equal_fits``.

    min_recordings: with fewer, fits by the noise are reported.
    """

    search: ForwardSearch
    evidence: Evidence
    folds: tuple[_Fold, ...]
    vehicle_for_log: Callable[[Point], Vehicle]
    noise: Noise
    jobs: int
    min_recordings: int

    def fit_first(self, vehicle: Vehicle, start: Point,
                  max_iterations: int = MAX_FIT_ITERATIONS) -> Point:
        """Fit a vehicle from a fit of the search; max_iterations: between measurements of weights.
        """
        return self._fit(vehicle, start, FIRST_PASSES, None, max_iterations)

    def fit(self, vehicle: Vehicle, start: Point) -> Point:
        """Fit a vehicle from another fit with equal weights, whose Jacobian is used at first."""
        return self._fit(vehicle, start, LATER_PASSES, start, MAX_FIT_ITERATIONS)

    def _fit(self, vehicle: Vehicle, start: Point, passes: int, reference: Point | None,
             max_iterations: int) -> Point:
        space = self.search.make_space(vehicle)
        x = space.transfer(space.start(vehicle, start.timing), start.space, start.x)
        for i in range(passes):
            # Iteratively reweighted: minimising the sum of ln s_kc is least squares with weights 1
            # / s_kc^2 that follow the fit.
            noise = _weigh_recordings_equally(self.noise, self.evidence, *space.split(x))
            if i == passes - 1:  # a Jacobian of another fit may end it too early
                reference = None
            fit = reference = refit(self.evidence, noise, space, x, reference, max_iterations,
                                    self.jobs)
            x = fit.x
        return fit

    def fit_by_noise(self, start: Point) -> Point:
        """Fit the vehicle of another fit by the noise of that fit.

        The noise of the base includes the effects, so they would be found too small.
        """
        noise = self.search.measure_noise(self.evidence, start.vehicle, start.timing)
        return refit(self.evidence, noise, start.space, start.x, start, jobs=self.jobs)

    def judge(self, fit: Point) -> CrossValidatedFit:
        """Fit without each recording in turn, and predict it."""
        # Leave one recording out, fit the others, and predict the one at the horizon of the
        # evaluation.
        work = [(fold.others, _rows_of_others(self.evidence, fit, fold.drive))
                for fold in self.folds]
        fits = list(each(_refit_others, work, self.jobs))
        errors = [compute_case_errors(self.vehicle_for_log(one), (fold.case,),
                                      self.evidence.l_r, (HORIZON_OFFSETS[HORIZON_INDEX],))[0]
                  for one, fold in zip(fits, self.folds, strict=True)]
        return CrossValidatedFit(fit, np.array([np.sqrt(np.mean(e**2, axis=1)) for e in errors]),
                         np.array([one.x for one in fits]))

    def select(self, equal: CrossValidatedFit) -> CrossValidatedFit:
        """Return the fit itself, or, of too few recordings for equal weights, that by the noise."""
        if self.weighs_equally:
            return equal
        return self.judge(self.fit_by_noise(equal.fit))

    @property
    def weighs_equally(self) -> bool:
        """Whether there are enough recordings for equal weights."""
        return len(self.folds) >= self.min_recordings


def error_of_size(size: float, sampling: float) -> float:
    """Return the standard error of an effect's size by sampling and by its form in the car.

    >>> round(error_of_size(0.4, 0.03), 3)
    0.05
    """
    return math.hypot(sampling, FORM_ERROR * size)


def make_equal_fits(search: ForwardSearch, train: RecordingSet, noise: Noise,
                    vehicle_for_log: Callable[[Point], Vehicle], jobs: int, min_recordings: int
                    ) -> EqualFits:
    """Prepare fits to the training recordings with motion capture.

    noise: of the search, with the weights of overlapping windows; vehicle_for_log: returns the
    vehicle of a fit with delays counted from the log.
    """
    cases = train.prepared.cases if train.prepared else ()
    if not cases:
        return EqualFits(search, train.evidence, (), vehicle_for_log, noise, jobs, min_recordings)
    # The reading of a slipping wheel depends on the drive force. With the many messages of the
    # encoder, a model with a wrong slip would get a wrong motor.
    evidence = train.evidence.motion_only()
    sha256 = [d.recording.sha256 for d in evidence.drives]
    drives = [sha256.index(case.sha256) for case in cases]
    folds = tuple(_Fold(k, evidence.drop_drive(k), case)
                  for k, case in zip(drives, cases, strict=True))
    return EqualFits(search, evidence, folds, vehicle_for_log, noise, jobs, min_recordings)


@dataclass(frozen=True, slots=True)
class FinalFit:
    """A fit whose numbers are reported.

    vehicle, timing: with all effects. point: the fit of the parameters that change the motion. With
    its covariance (k, k) the error of any quantity of the car can be computed, see
    ``claims.find_changes``. stds: standard errors by name, in SI units.
    """

    vehicle: Vehicle
    timing: MessageTiming
    point: Point
    covariance: FloatArray
    stds: Mapping[str, float]


def make_final_fits(fits: EqualFits, points: Sequence[Point],
                    compute_covariance: Callable[[Point], FloatArray]) -> list[FinalFit]:
    """Return the fits to report, of the base and with one effect more each.

    points: the same by the noise of the search; compute_covariance: of one of these.

    With few recordings these are the points. Else every recording has the same weight, and standard
    errors follow from a jackknife over recordings.
    """
    by_noise = [_unchanged_fit(point, compute_covariance(point)) for point in points]
    if not fits.weighs_equally:
        return by_noise
    judged = fits.judge(fits.fit_first(points[0].vehicle, points[0]))
    found = []
    for searched in by_noise:
        # The fit with equal weights has no sensors, so effects on readings keep their numbers.
        moving = replace(searched.vehicle, effects=tuple(
            a for a in searched.vehicle.effects if not affects_readings_only(a.effect)))
        if {a.name for a in moving.effects} != {a.name for a in judged.fit.vehicle.effects}:
            judged = fits.judge(fits.fit(moving, judged.fit))
        found.append(_add_sensor_effects(judged, searched))
    return found


def _unchanged_fit(point: Point, covariance: FloatArray) -> FinalFit:
    stds = point.space.standard_errors(point.x, covariance)
    return FinalFit(point.vehicle, point.timing, point, covariance, stds)


def _add_sensor_effects(judged: CrossValidatedFit, searched: FinalFit) -> FinalFit:
    """Add the effects on sensors of the fit of the search to a fit of the motion.

    All folds have the same prior, so the jackknife lacks its share of the covariance.
    """
    fit = judged.fit
    # Jackknife over recordings: (K - 1) / K times the sum of squared deviations of the K fits.
    deviation = judged.fold_points - judged.fold_points.mean(axis=0)
    k = len(deviation)
    bread = np.linalg.inv(fit.normal)
    covariance = ((k - 1) / k * deviation.T @ deviation
                  + bread @ fit.space.prior_precision @ bread)
    motion = {a.name: a for a in fit.vehicle.effects}
    effects = tuple(motion.get(a.name, a) for a in searched.vehicle.effects)
    timing = replace(fit.timing, message_age=searched.timing.message_age,
                     gyro_age=searched.timing.gyro_age)
    stds = fit.space.standard_errors(fit.x, covariance)
    return FinalFit(replace(fit.vehicle, effects=effects), timing, fit, covariance,
                    {**searched.stds, **stds})


def _weigh_recordings_equally(noise: Noise, evidence: Evidence, vehicle: Vehicle,
                              timing: MessageTiming) -> Noise:
    """Return the noise with which the loss of the motion is the sum of ln s_kc, to first order.

    Residual e_i in read-out and channel c of recording k, with n_k of all N windows, becomes

        e_i / s_c * (s_c / s_kc) * sqrt(N / (K n_k))

    The read-outs of one window are correlated and count as one.
    """
    motion = replace_diverged(evidence.residuals(vehicle, timing).motion)
    drive = evidence.motion_drive
    used = np.unique(drive)
    # A recording of few windows is pulled towards the pooled scale, as if it had TYPICAL_WINDOWS
    # more: else a short, smooth one would get a weight without limit.
    pooled = np.mean(motion**2, axis=0) + 1e-12
    scale = np.ones(motion.shape)
    for k in used:
        mine = drive == k
        n = int(mine.sum())
        square = (np.sum(motion[mine]**2, axis=0) + TYPICAL_WINDOWS * pooled) / (
            n + TYPICAL_WINDOWS)
        scale[mine] = np.sqrt(pooled / square * len(motion) / (len(used) * n))
    c = len(pooled)
    weight = noise.weight.copy()
    weight[:c] /= len(READ_OUTS)
    return replace(noise, motion=np.diag(1.0 / np.sqrt(pooled)), age_scale=scale, weight=weight)


def _refit_others(work: tuple[Evidence, Point]) -> Point:
    others, start = work
    return refit_reusing_jacobian(others, start.noise, start.space, start.x, start, FOLD_ITERATIONS)


def _rows_of_others(evidence: Evidence, fit: Point, drive: int) -> Point:
    """Return a fit with the rows of all recordings but one."""
    keep = evidence.motion_drive != drive
    scale = np.broadcast_to(fit.noise.age_scale, (len(keep), len(fit.noise.motion)))
    noise = replace(fit.noise, age_scale=scale[keep])
    rows = np.concatenate([np.repeat(keep, len(noise.motion)),
                           np.repeat(evidence.sensor_drive != drive, len(noise.sensors))])
    return Point(noise, fit.space, fit.x, fit.residual[rows], fit.weight[rows], fit.jacobian[rows])
