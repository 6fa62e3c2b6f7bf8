"""Joint fit of all sub-models: Levenberg-Marquardt on predictions, with weak priors and bounds.

    min_x  sum rho((predict(x) - measured) / scale) + PRIOR_SCALE^-2 |x|^2,   low <= x <= high

1. Fit with the scale of first errors, then with the robust scale of the residuals, until that no
   longer changes.
2. Covariance over blocks, plus the errors of what is fixed: marker frame, latency, command waits.
3. A parameter is identified if the data alone, without the prior, give it a small error, and if
   the loss two standard errors away agrees with the quadratic approximation.
4. Where the data need it, fit again with the effect ``back_emf``: the motor of another car may lose
   force with speed at little throttle too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.process.jobs import each
from dart_hal.core.timing import PWM_WAIT_STD
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording.dart import Grid, Recording, Reference, grid
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.fitting.covariance import (
    MIN_RECORDING_BLOCKS,
    block_covariance,
    fixed_value_covariance,
)
from dart_hal.vehicle.fitting.least_squares import BOUND_TOLERANCE, Solution
from dart_hal.vehicle.fitting.levenberg_marquardt import descend
from dart_hal.vehicle.fitting.profile import agrees_with_quadratic
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA, soft_l1, soft_l1_weight
from dart_hal.vehicle.flat import names as flat_names
from dart_hal.vehicle.flat import unit, value
from dart_hal.vehicle.parameters import AxleTyres, SpeedLoop, Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_hal.vehicle.steering import is_straight
from dart_lab.identification.evidence.coordinates import Coordinates
from dart_lab.identification.fit import MAX_TIME_STD, FittedParameter, SubmodelFit
from dart_lab.identification.prediction.rollout import label_stretches

from .problem import (
    CHANNELS,
    PREDICTED_UNITS,
    PREDICTION_TIME,
    READ_TIMES,
    START_INTERVAL,
    ShootingProblem,
)

# Free parameters of each sub-model. Mass and inertia are never free (a fit shrinks them to mimic
# noise). C and E of a tyre are confounded with D and B below the grip limit. With these two fixed,
# D was up to 73 standard errors off on cars with tyres of another shape.
FREE = {
    "friction": ("a", "b", "c"),
    "motor": ("d", "e", "g"),
    "steering": ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right"),
    "delay": ("steering_s", "throttle_s", "steering_lag_s", "throttle_lag_s"),
    "tyres": ("front_D", "front_C", "front_B", "front_E", "rear_cornering_stiffness"),
}
# Nuisance parameters: free within their standard error where that is known, and no result. Forces
# are only known as well as the mass, tyres as the inertia, timing as slew and play of the steering,
# and the steering map as the wheelbase.
NUISANCE = ("body.mass", "body.yaw_inertia", "steering_rate_limit.k", "steering_backlash.k",
            "body.wheelbase", "body.l_f", "body.l_r")
SPEED_LOOP_NAMES = ("gain", "max_force")
AXLE_TYRE_NAMES = ("front_D", "front_C", "front_B", "rear_D", "rear_C", "rear_B")
# Effect that a fit adds where the data need it: another form of the motor. DART has none of it.
BACK_EMF = "back_emf"
BACK_EMF_NAME = "back_emf.k"
# [throttle above the dead band] Its prior standard deviation is the base's loss e T at this T.
BACK_EMF_THROTTLE = 0.25
# Parameters whose physical bound is a valid result.
TYRE_SHAPE_NAMES = ("front_C", "front_E", "rear_C")
# [m/s, m/s, rad/s] Typical errors of a first model of a car of 1:10 after one second.
FIRST_ERRORS = (0.15, 0.05, 0.4)
# [typical errors] Larger residuals count less than their square.
LOSS_SCALE = 2.0
# [prior standard deviations] Step of the central differences.
PRIOR_STEP = 1e-2
# [s] The same of delays: the delay of a held command is smooth only beyond the grid.
TIMING_STEP = 4e-3
# [s] Standard deviation of the measured latency of poses: 0.1 to 0.5 ms of 12 emulated cars.
POSE_LATENCY_STD = 0.5e-3
# [s] Disturbances of a drive are independent after that time.
BLOCK_DURATION = 5.0
# [typical errors] A diverged rollout counts as this.
MAX_RESIDUAL = 1e3
# [unmeasured prior] A parameter is identified if the standard error from the data alone is below
# it. The posterior has the information of the data and of its prior: std^-2 = data^-2 + 1.
MAX_IDENTIFIED_STD = 1.0 / 3.0
# Read-outs of one window and windows of one block are correlated. So the prior is weighed against
# a block of n residuals, and not against each of them: its scale is n^-1/2.
PRIOR_SCALE = (len(READ_TIMES) * BLOCK_DURATION / START_INTERVAL)**-0.5
# Reduction of the loss that an added effect needs: a block of residuals. Without the effect in the
# car it was 8 at most in twelve simulated drives, with it 93 at least.
MIN_ADDED_GAIN = PRIOR_SCALE**-2
# Share of it that one Gauss-Newton step must predict: far from the minimum a step predicts less.
MIN_TRIED_SHARE = 0.1
# Relative change of the scale of the residuals below which it has converged. A car far from the
# base needs more passes: after two, an 1:8 car had a motor 5 standard errors off. That car needed
# five, single days of DART three to five.
SCALE_TOLERANCE = 0.1
MAX_PASSES = 8

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class JointFit:
    """Result of a joint fit.

    fits: one per sub-model; names, covariance (k, k): of all free parameters together; nuisance:
    fitted nuisance parameters by full name, which are part of ``vehicle``; before, after: RMSE of
    CHANNELS [m/s, m/s, rad/s] over all windows and read-outs.
    """

    vehicle: Vehicle
    fits: dict[str, SubmodelFit]
    names: tuple[str, ...]
    covariance: FloatArray
    windows: int
    before: tuple[float, ...]
    after: tuple[float, ...]
    nuisance: Mapping[str, FittedParameter]


def free_names(base: Vehicle, submodels: Sequence[str]) -> tuple[str, ...]:
    """Return the names "group.key" of the free parameters."""
    keys = dict(FREE)
    if isinstance(base.tyres, AxleTyres):
        keys["tyres"] = AXLE_TYRE_NAMES
    if isinstance(base.motor, SpeedLoop):
        keys["motor"] = SPEED_LOOP_NAMES
    groups = [g for g in keys if g in submodels and not (g == "tyres" and base.kind == "kinematic")]
    return tuple(f"{group}.{key}" for group in groups for key in keys[group])


def fit_jointly(problem: ShootingProblem, base: Vehicle, submodels: Sequence[str] = tuple(FREE),
                progress: Progress | None = None,
                known: Mapping[str, float] | None = None) -> JointFit:
    """Fit the parameters of the sub-models to the windows, starting at ``base``.

    known: standard errors of the base by name, which make the prior stronger. Raises UsageError
    for a free parameter of the base that is 0 and would be multiplied by a factor.
    """
    known = known or {}
    found = _fit(problem, base, submodels, progress, known)
    if "motor" not in submodels or isinstance(base.motor, SpeedLoop) or any(
            active.name == BACK_EMF for active in base.effects):
        return found
    if not _needs_effect(problem, found, apply(found.vehicle, BACK_EMF), known):
        return found
    extended = _fit(problem, apply(base, BACK_EMF), submodels, progress, known, found.vehicle)
    without, with_it = (problem.predict(fit.vehicle, fit.vehicle.body.l_r - base.body.l_r)
                        - problem.measured for fit in (found, extended))
    scale = _typical_size(without)
    gain = float((soft_l1(without / scale, LOSS_SCALE)
                  - soft_l1(with_it / scale, LOSS_SCALE)).sum())
    return extended if gain > MIN_ADDED_GAIN else found


def _needs_effect(problem: ShootingProblem, found: JointFit, vehicle: Vehicle,
                  known: Mapping[str, float]) -> bool:
    """Return whether one Gauss-Newton step from the fit predicts that BACK_EMF lowers the loss.

    vehicle: the fitted one with the effect, of size 0.
    """
    names = (*found.names, *found.nuisance, BACK_EMF_NAME)
    work = _JointProblem(problem, _make_space(vehicle, names, known), vehicle.body.l_r, None)
    x = np.zeros(len(names))
    scale = _typical_size(work.error(x))
    residual = work.residual(x, scale)
    jacobian = work.jacobian(x, scale)
    weighted = jacobian * soft_l1_weight(residual, LOSS_SCALE)[:, None]
    normal = weighted.T @ jacobian + PRIOR_SCALE**-2 * np.eye(len(names))
    step = -np.linalg.solve(normal, weighted.T @ residual)
    predicted = step[-1]**2 / np.linalg.inv(normal)[-1, -1]
    return bool(step[-1] > 0.0 and predicted > MIN_TRIED_SHARE * MIN_ADDED_GAIN)


def _make_space(base: Vehicle, names: tuple[str, ...], known: Mapping[str, float]) -> Coordinates:
    """Return the coordinates of a fit."""
    if BACK_EMF_NAME not in names:
        return Coordinates(base, names, known)
    # Both losses of force with speed may be 0, so that of the motor is no factor either.
    loss = float(value(base, "motor.e"))
    return Coordinates(base, names, known, {BACK_EMF_NAME: BACK_EMF_THROTTLE * loss,
                                            "motor.e": loss})


def _fit(problem: ShootingProblem, base: Vehicle, submodels: Sequence[str],
         progress: Progress | None, known: Mapping[str, float], start: Vehicle | None = None
         ) -> JointFit:
    """Fit as ``fit_jointly``, with the effects of the base alone.

    start: the same without an effect that the base has with size 0, fitted before.
    """
    begin = time.process_time()
    present = flat_names(base)
    results = (*free_names(base, submodels), *(n for n in present if n == BACK_EMF_NAME))
    names = (*results, *(n for n in NUISANCE if n in present and known.get(n, 0.0) > 0.0))
    space = _make_space(base, names, known)
    work = _JointProblem(problem, space, base.body.l_r, progress)
    car = find_scale(base.body)
    first_errors = np.array(FIRST_ERRORS) * [car.speed, car.speed, car.yaw_rate]
    scale = np.broadcast_to(first_errors[:, None], (*problem.measured.shape[:2], 1))
    x = space.first
    if start is not None:
        fitted = flat_names(start)
        x = space.find(np.array([value(start if n in fitted else base, n) for n in names]))
        scale = _typical_size(work.error(x))
        # The valley from 0 is long: start the size at its prior standard deviation.
        x[[i for i, n in enumerate(names) if n not in fitted]] = 1.0
    # 1. Fit, with the scale of the residuals from the pass before.
    for _ in range(MAX_PASSES):
        data = work.solve(x, scale)
        x = data.x
        before_pass = scale
        scale = _typical_size(work.error(x))
        if np.max(np.abs(scale / before_pass - 1.0)) < SCALE_TOLERANCE:
            break
    data = work.evaluate(data, scale)
    # 2. Covariance in units of the prior, then in SI units.
    relative = _covariance(data, problem) + fixed_value_covariance(
        data, _fixed_value_columns(problem, names, data, space, scale), prior=PRIOR_SCALE**-2)
    slope = space.slope(x)
    covariance = relative * np.outer(slope, slope)
    vehicle = space.vehicle(x)
    # 3. Which parameters the data identify.
    std = np.sqrt(np.diag(relative))
    without_prior = 1.0 / np.sqrt(np.maximum(std**-2 - 1.0, np.finfo(float).tiny))
    identified = ((without_prior * slope < MAX_IDENTIFIED_STD * space.usual(x))
                  & work.agrees(data, scale, std))
    cpu = time.process_time() - begin
    before = _rmse(work.error(np.zeros(len(names))))
    after = _rmse(work.error(x))
    braked = f", {problem.braked} left out because the ESC brakes" if problem.braked else ""
    note = (f"{len(problem)} stretches of {PREDICTION_TIME:g} s predicted{braked}; error (rms) "
            + ", ".join(
        f"{c} {b:.3g} -> {a:.3g} {u}"
        for c, b, a, u in zip(CHANNELS, before, after, PREDICTED_UNITS, strict=True)))
    fits = {s: _extract_submodel(s, vehicle, names, covariance, identified, data, cpu, note)
            for s in FREE if any(name.startswith(f"{s}.") for name in names)}
    errors = np.sqrt(np.diag(covariance))
    count = len(results)
    nuisance = {name: FittedParameter(float(value(vehicle, name)), float(errors[i]),
                                      unit(vehicle, name))
                for i, name in enumerate(names) if i >= count or name == BACK_EMF_NAME}
    return JointFit(vehicle, fits, results, covariance[:count, :count], len(problem), before,
                    after, nuisance)


UsedRecordings = list[tuple[Recording, Grid]]


def fit_from_recordings(recordings: Sequence[Recording], base: Vehicle,
                        submodels: Sequence[str] = tuple(FREE),
                        reference: Reference | None = None, progress: Progress | None = None,
                        known: Mapping[str, float] | None = None
                        ) -> tuple[JointFit, UsedRecordings, dict[str, tuple[str, ...]]]:
    """Fit to recordings; return (fit, used recordings with grids, reasons of the unused files).

    Raises RecordingError if no recording has a window to predict, or all are too short.
    """
    used = UsedRecordings()
    unused = dict[str, tuple[str, ...]]()
    for r in recordings:
        try:
            if r.mocap is None:
                raise RecordingError("no motion capture: a joint fit predicts the measured motion")
            g = grid(r, reference, base.body.l_r, turning=True)
            ShootingProblem.from_grids([g])
        except RecordingError as err:
            unused[str(r.path)] = (f"not used: {err.what}",)
        else:
            used.append((r, g))
    if not used:
        reasons = "; ".join(dict.fromkeys(why for (why,) in unused.values()))
        raise RecordingError("none of these recordings can be predicted", found=reasons,
                             expected="motion capture of a moving car",
                             remedy="without --joint the sub-models are fitted one by one")
    # A command waits for its row between 0 and the time of a row, and by the same in a whole drive
    # if both have one clock.
    waits = tuple(_row_time(r) / math.sqrt(12.0) if r.commands is None else PWM_WAIT_STD
                  for r, _ in used)
    problem = replace(ShootingProblem.from_grids([g for _, g in used]), waits=waits)
    _, stretch = label_stretches(problem.parts, BLOCK_DURATION)
    if len(np.unique(stretch)) < 2:
        raise RecordingError(
            "too little driving for a joint fit", read=", ".join(str(r.path) for r, _ in used),
            found=f"one block of {BLOCK_DURATION:g} s",
            expected="two or more, which give the standard errors",
            remedy="record a longer drive, or add recordings")
    found = fit_jointly(problem, base, submodels, progress, known)
    rows = [_row_time(r) for r, _ in used if r.commands is None]
    if rows and "delay" in found.fits:
        note = (f"delays are for a replay that holds logged rows, {0.5 * np.mean(rows):.3f} s less "
                "than from the command itself, because a row is later by that in the mean")
        delay = found.fits["delay"]
        found = replace(found, fits={**found.fits,
                                     "delay": replace(delay, notes=(*delay.notes, note))})
    return found, used, unused


def _row_time(recording: Recording) -> float:
    """Return the time [s] between two rows of a recording with motion capture."""
    assert recording.mocap is not None
    return float(np.median(np.diff(recording.mocap.t)))


class _JointProblem:
    """Residuals and Jacobian over the coordinates."""

    def __init__(self, problem: ShootingProblem, space: Coordinates, l_r: float,
                 progress: Progress | None) -> None:
        """l_r: from the rear axle to the point of the measured motion [m]."""
        self._problem = problem
        self._space = space
        self._l_r = l_r
        self._progress = progress
        self._rounds = 0

    def error(self, x: FloatArray) -> FloatArray:
        vehicle = self._space.vehicle(x)
        return (self._problem.predict(vehicle, vehicle.body.l_r - self._l_r)
                - self._problem.measured)

    def solve(self, x0: FloatArray, scale: FloatArray) -> Solution:
        space = self._space

        def slopes(x: FloatArray, r: FloatArray) -> FloatArray:
            self._report_progress()
            return self.jacobian(x, scale)

        return descend(lambda x: self.residual(x, scale), slopes, x0, space.low, space.high,
                       robust=LOSS_SCALE, prior=PRIOR_SCALE**-2)

    def evaluate(self, data: Solution, scale: FloatArray) -> Solution:
        """Return the solution with residuals and slopes of ``scale``."""
        r = self.residual(data.x, scale)
        return replace(data, residual=r, jacobian=self.jacobian(data.x, scale),
                       weight=soft_l1_weight(r, LOSS_SCALE))

    def agrees(self, data: Solution, scale: FloatArray, std: FloatArray) -> BoolArray:
        """Return whether the loss two standard errors away (k,) agrees with the slopes."""
        space = self._space
        return agrees_with_quadratic(lambda x: self.residual(x, scale), data, std, space.low,
                                     space.high, robust=LOSS_SCALE, prior=PRIOR_SCALE**-2)

    def residual(self, x: FloatArray, scale: FloatArray) -> FloatArray:
        """Return the scaled errors (n,) at x."""
        error = np.clip(self.error(x) / scale, -MAX_RESIDUAL, MAX_RESIDUAL)
        return np.asarray(np.nan_to_num(error, nan=MAX_RESIDUAL).ravel())

    def jacobian(self, x: FloatArray, scale: FloatArray) -> FloatArray:
        """Return central differences (n, k); one-sided at a bound."""
        # The columns are independent: on a cluster the workers compute them.
        found = dict(each(partial(self._column, x, scale), range(len(x))))
        return np.stack([found[i] for i in range(len(x))], axis=1)

    def _column(self, x: FloatArray, scale: FloatArray, i: int) -> tuple[int, FloatArray]:
        """Return a column of the Jacobian (n,), with its number."""
        space = self._space
        step = (TIMING_STEP / space.width(i) if space.names[i].startswith("delay.")
                else PRIOR_STEP)
        up = x.copy()
        down = x.copy()
        up[i] = min(x[i] + step, space.high[i])
        down[i] = max(x[i] - step, space.low[i])
        return i, ((self.residual(up, scale) - self.residual(down, scale))
                   / (up[i] - down[i]))

    def __getstate__(self) -> dict[str, Any]:
        """Return what a worker of a cluster needs: not the progress, which is shown here."""
        return {**self.__dict__, "_progress": None}

    def _report_progress(self) -> None:
        self._rounds += 1
        if self._progress is not None:
            self._progress(1.0 - 0.8**self._rounds, f"joint fit, round {self._rounds}")


def _fixed_value_columns(problem: ShootingProblem, names: tuple[str, ...], data: Solution,
                         space: Coordinates, scale: FloatArray) -> FloatArray:
    """Changes (n, h) of the residuals by one standard error of marker frame, latency and waits.

    - Marker frame: dv_y = -omega dL_x + v_x dtheta, dv_x = omega dL_y.
    - Latency of the poses: a longer one shortens both delays by the same time.
    - Wait of the commands of one recording for a pulse or row: the same, in its windows.
    """
    columns = []
    along, _, turning = np.moveaxis(problem.measured, 1, 0)
    for channel, series, which in ((1, -turning, 0), (1, along, 1), (0, turning, 2)):
        change = np.zeros_like(problem.measured)
        change[:, channel] = series * problem.frame_errors(which)
        columns.append((change / scale).ravel())
    shift = np.zeros(len(data.residual))  # d residual / d time of both delays [1/s]
    for i, name in enumerate(names):
        if name in ("delay.steering_s", "delay.throttle_s"):
            shift += data.jacobian[:, i] / space.width(i)
    columns.append(POSE_LATENCY_STD * shift)
    recording, _ = label_stretches(problem.parts, BLOCK_DURATION)
    for i, wait in enumerate(problem.waits):
        inside = np.broadcast_to(recording == i, problem.measured.shape).ravel()
        columns.append(np.where(inside, wait * shift, 0.0))
    return np.stack(columns, axis=1)


def _typical_size(error: FloatArray) -> FloatArray:
    """Return the robust scale (len(READ_TIMES), 3, 1) of the errors (len(READ_TIMES), 3, n)."""
    return np.asarray(MAD_TO_SIGMA * np.median(np.abs(error), axis=2, keepdims=True) + 1e-6)


def _rmse(error: FloatArray) -> tuple[float, ...]:
    return tuple(np.sqrt(np.mean(error**2, axis=(0, 2))).tolist())


def _covariance(data: Solution, problem: ShootingProblem) -> FloatArray:
    """Return the covariance over blocks: recordings if there are many, else parts of them.

    It includes the prior: a direction without information keeps the prior's variance, 1.
    """
    recording, stretch = label_stretches(problem.parts, BLOCK_DURATION)
    block = recording if len(np.unique(recording)) >= MIN_RECORDING_BLOCKS else stretch
    repeated = np.broadcast_to(block, (data.residual.size // len(block), len(block))).ravel()
    return block_covariance(data, repeated, prior=PRIOR_SCALE**-2, count_parameters=True)


def _extract_submodel(name: str, vehicle: Vehicle, names: tuple[str, ...], covariance: FloatArray,
                      identified: BoolArray, data: Solution, cpu: float, note: str) -> SubmodelFit:
    mine = [i for i, full in enumerate(names) if full.startswith(f"{name}.")]
    std = np.sqrt(np.diag(covariance))
    estimates = {names[i].partition(".")[2]: FittedParameter(
        float(value(vehicle, names[i])), float(std[i]), unit(vehicle, names[i]),
        bool(identified[i]) and (name != "delay" or float(std[i]) < MAX_TIME_STD)) for i in mine}
    # A delay or lag of 0 is a valid result and not a bound that the fit hit; the upper bound is.
    # The amplitude of a straight line of the steering is not determined.
    stopped = tuple(key for i in mine if data.at_bound[i]
                    and (key := names[i].partition(".")[2]) not in TYRE_SHAPE_NAMES
                    and not is_straight(key, asdict(vehicle.steering))
                    and (name != "delay" or value(vehicle, names[i]) > BOUND_TOLERANCE))
    return SubmodelFit(name, estimates, covariance[np.ix_(mine, mine)], len(data.residual),
                       data.rmse, "typical error", data.converged, stopped, cpu,
                       (note,
                        "one fit of all: its covariance across the sub-models is in the file"))
