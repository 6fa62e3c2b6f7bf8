"""Fit the numbers that are reported: of the base, and with one accepted effect more each.

The search weighs errors by their measured covariance. That is best where the model is complete, and
what is left is noise. In recordings of a real car much of what is left is an error of the model,
different in each kind of driving, and the small errors of slow driving would decide everything.

Over K recordings, with s_kc the RMS error 1 s ahead in channel c of recording k, as the fit to the
others predicts it, a fit is judged by

    L = mean_k mean_c ln s_kc

so every recording has the same weight, however long it is and however well the car can be predicted
in it. A fit to recordings of equal weight minimises the same over its own recordings. Since
d ln s = sum_i e_i de_i / (n s^2), that is least squares with weights 1 / (n s^2), which are
measured again after each fit. It takes the place of the weighting by noise from six recordings on.
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

from .error_summaries import Ratio, geometric_mean
from .evidence.drive import READ_OUTS
from .evidence.noise import Noise, replace_diverged
from .evidence.residuals import Evidence, affects_readings_only
from .evidence.space import MessageTiming
from .gains import AT, Side, compute_case_errors
from .search.fit import Point, refit, refit_reusing_jacobian
from .search.forward import ForwardSearch

TYPICAL_WINDOWS = 5
"""Windows of an average recording that are added to each recording's mean square. The error of one
with a single window is known by chance only."""
FORM_ERROR = 0.10
"""Share of an effect's size by which a car that has the same effect, but not its very equation,
seems to have another size. Of 136 effects that other equations had hidden, 90 % intervals of the
sampling error alone held 65 %, of any kind of it (sandwich, jackknife, long or short blocks); with
a share of .05, .08, .10, .12 they hold 81, 87, 88 and 93 %."""
FIRST_PASSES, LATER_PASSES = 3, 2
"""Fits with weights measured again; the later ones start near their end."""


class JudgedFit(NamedTuple):
    """A fit to all recordings, and how well such fits predict recordings left out.

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

    def relative_to(self, other: JudgedFit) -> Ratio:
        """Its errors over those of another, by recording."""
        return geometric_mean(np.exp(np.log(self.errors / other.errors).mean(axis=1)))


@dataclass(frozen=True, slots=True)
class _Fold:
    """One recording left out: the evidence of the others, and the windows of the one."""

    drive: int
    others: Evidence
    case: Case


@dataclass(frozen=True, slots=True)
class EqualFits:
    """Fits of the motion in which every recording has the same weight, see ``make_equal_fits``.

    least_recordings: with fewer, fits by the noise are reported.
    """

    search: ForwardSearch
    evidence: Evidence
    folds: tuple[_Fold, ...]
    as_logged: Callable[[Point], Vehicle]
    noise: Noise
    jobs: int
    least_recordings: int

    def fit(self, vehicle: Vehicle, near: Point, passes: int = LATER_PASSES) -> Point:
        """Fit a vehicle from a fit nearby, weights measured before each pass."""
        space = self.search.make_space(vehicle)
        x = space.transfer(space.start(vehicle, near.timing), near.space, near.x)
        for _ in range(passes):
            noise = _weigh_recordings_equally(self.noise, self.evidence, *space.split(x))
            fit = refit(self.evidence, noise, space, x, jobs=self.jobs)
            x = fit.x
        return fit

    def fit_by_noise(self, near: Point) -> Point:
        """Fit the vehicle of a fit nearby by the noise that this fit leaves.

        By the noise of the base, which has the effects in it, they would be found too small.
        """
        noise = self.search.measure_noise(self.evidence, near.vehicle, near.timing)
        return refit(self.evidence, noise, near.space, near.x, jobs=self.jobs)

    def judge(self, fit: Point) -> JudgedFit:
        """Fit without each recording, and predict it."""
        work = [(fold.others, _rows_of_others(self.evidence, fit, fold.drive))
                for fold in self.folds]
        fits = list(each(_refit_others, work, self.jobs))
        errors = [compute_case_errors(self.as_logged(one), (fold.case,), self.evidence.l_r)[AT]
                  for one, fold in zip(fits, self.folds, strict=True)]
        return JudgedFit(fit, np.array([np.sqrt(np.mean(e**2, axis=1)) for e in errors]),
                         np.array([one.x for one in fits]))

    def select(self, equal: JudgedFit) -> JudgedFit:
        """The fit itself, or with few recordings that by the noise: one is a large part of them."""
        if self.weighs_equally:
            return equal
        return self.judge(self.fit_by_noise(equal.fit))

    @property
    def weighs_equally(self) -> bool:
        """Whether there are enough recordings for equal weights."""
        return len(self.folds) >= self.least_recordings


def error_of_size(size: float, sampling: float) -> float:
    """Return the standard error of an effect's size: by sampling, and by its form in the car.

    >>> round(error_of_size(0.4, 0.03), 3)
    0.05
    """
    return math.hypot(sampling, FORM_ERROR * size)


def make_equal_fits(search: ForwardSearch, train: Side, noise: Noise,
                    as_logged: Callable[[Point], Vehicle], jobs: int, least_recordings: int
                    ) -> EqualFits:
    """Prepare fits to the training recordings with motion capture.

    noise: of the search, with the weights of windows that overlap; as_logged: the vehicle of a fit,
    its delays counted from the log.
    """
    cases = train.prepared.cases if train.prepared else ()
    if not cases:
        return EqualFits(search, train.evidence, (), as_logged, noise, jobs, least_recordings)
    # what an encoder reads of a slipping wheel depends on the drive force: its many messages would
    # decide the motor of a model that is only wrong about the slip
    evidence = train.evidence.motion_only()
    sha256 = [d.recording.sha256 for d in evidence.drives]
    drives = [sha256.index(case.sha256) for case in cases]
    folds = tuple(_Fold(k, evidence.drop_drive(k), case)
                  for k, case in zip(drives, cases, strict=True))
    return EqualFits(search, evidence, folds, as_logged, noise, jobs, least_recordings)


@dataclass(frozen=True, slots=True)
class FinalFit:
    """A fit whose numbers are reported.

    vehicle, timing: with all effects; point: the fit of what moves the car, by which errors of
    other quantities follow from covariance (k, k); stds: standard error by name, in SI units.
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

    With few recordings these are points. Else every recording has the same weight, and standard
    errors are those of the jackknife over recordings.
    """
    by_noise = [_as_it_is(point, compute_covariance(point)) for point in points]
    if not fits.weighs_equally:
        return by_noise
    judged = fits.judge(fits.fit(points[0].vehicle, points[0], FIRST_PASSES))
    found = []
    for sensors in by_noise:
        moving = replace(sensors.vehicle, effects=tuple(
            a for a in sensors.vehicle.effects if not affects_readings_only(a.effect)))
        if {a.name for a in moving.effects} != {a.name for a in judged.fit.vehicle.effects}:
            judged = fits.judge(fits.fit(moving, judged.fit))
        found.append(_with_sensors(judged, sensors))
    return found


def _as_it_is(point: Point, covariance: FloatArray) -> FinalFit:
    stds = point.space.standard_errors(point.x, covariance)
    return FinalFit(point.vehicle, point.timing, point, covariance, stds)


def _with_sensors(judged: JudgedFit, sensors: FinalFit) -> FinalFit:
    """The fit of the motion with what sensors read by another fit.

    The prior is part of the covariance, as the fits without one recording each all share it.
    """
    fit, moved = judged.fit, judged.left_out - judged.left_out.mean(axis=0)
    k = len(moved)
    bread = np.linalg.inv(fit.normal)
    covariance = ((k - 1) / k * moved.T @ moved
                  + bread @ np.diag(fit.space.prior_weight) @ bread)
    motion = {a.name: a for a in fit.vehicle.effects}
    effects = tuple(motion.get(a.name, a) for a in sensors.vehicle.effects)
    timing = replace(fit.timing, message_age=sensors.timing.message_age,
                     gyro_age=sensors.timing.gyro_age)
    stds = fit.space.standard_errors(fit.x, covariance)
    return FinalFit(replace(fit.vehicle, effects=effects), timing, fit, covariance,
                    {**sensors.stds, **stds})


def _weigh_recordings_equally(noise: Noise, evidence: Evidence, vehicle: Vehicle,
                              timing: MessageTiming) -> Noise:
    """The noise by which the loss of the motion is the sum of ln s_kc, to first order.

    Of residual e_i in read-out and channel c of recording k, with n_k of all N windows:

        e_i / s_c * (s_c / s_kc) * sqrt(N / (K n_k))

    The read-outs of one window err together and count as one.
    """
    motion = replace_diverged(evidence.residuals(vehicle, timing).motion)
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
    return replace(noise, motion=np.diag(1.0 / np.sqrt(pooled)), age_scale=certain, weight=weight)


def _refit_others(work: tuple[Evidence, Point]) -> Point:
    others, near = work
    return refit_reusing_jacobian(others, near.noise, near.space, near.x, near)


def _rows_of_others(evidence: Evidence, fit: Point, drive: int) -> Point:
    """A fit with the rows of all recordings but one."""
    keep = evidence.motion_drive != drive
    certain = np.broadcast_to(fit.noise.age_scale, (len(keep), len(fit.noise.motion)))
    noise = replace(fit.noise, age_scale=certain[keep])
    rows = np.concatenate([np.repeat(keep, len(noise.motion)),
                           np.repeat(evidence.sensor_drive != drive, len(noise.sensors))])
    return Point(noise, fit.space, fit.x, fit.residual[rows], fit.weight[rows], fit.jacobian[rows])
