"""All sub-models at once: Gauss-Newton on the predictions, with weak priors and bounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import PWM_WAIT_STD
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording.dart import Grid, Recording, Reference, grid
from dart_hal.vehicle.fitting.covariance import (
    MIN_RECORDING_BLOCKS,
    block_covariance,
    fixed_value_covariance,
)
from dart_hal.vehicle.fitting.least_squares import BOUND_TOLERANCE, Solution
from dart_hal.vehicle.fitting.levenberg_marquardt import descend
from dart_hal.vehicle.fitting.profile import agrees_with_quadratic
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA, soft_l1_weight
from dart_hal.vehicle.flat import names as flat_names
from dart_hal.vehicle.flat import unit, value
from dart_hal.vehicle.parameters import AxleTyres, Vehicle
from dart_lab.identification.fit import TIME_KNOWN, Estimate, Fit
from dart_lab.identification.prediction.rollout import stretches

from .coordinates import Coordinates
from .problem import CHANNELS, EVERY, HORIZON, READ, UNITS, Problem

FREE = {
    "friction": ("a", "b", "c"),
    "motor": ("d", "e", "g"),
    "steering": ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right"),
    "delay": ("steering_s", "throttle_s", "steering_lag_s", "throttle_lag_s"),
    "tyres": ("front_D", "front_B", "rear_cornering_stiffness"),
}
"""What moves: mass and inertia never (a fit shrinks them to mimic noise), and of the front
tyre two of four, because C and E are told apart from D only beyond the grip limit."""
NUISANCE = ("body.mass", "body.yaw_inertia", "steering_rate_limit.k", "steering_backlash.k",
            "body.wheelbase", "body.l_f", "body.l_r")
"""What moves within its own standard error where that is known, and is no result: forces are only
known as well as the mass, tyres as the inertia, timing as slew and play of the steering, and the
steering map as the wheelbase."""
AXLE = ("front_D", "front_B", "rear_D", "rear_B")
SCALE = (0.15, 0.05, 0.4)  # m/s, m/s, rad/s; typical errors of a first model after a second
LOSS_SCALE = 2.0  # typical errors from where on a residual counts less than its square
STEP = 1e-2  # of the prior, to both sides
TIMING_STEP = 4e-3  # s, both sides: a delay of held commands is smooth only beyond their grid
POSE_LATENCY_STD = 0.5e-3
"""s, one sigma of the latency of poses as it was measured: of 12 emulated cars 0.1 to 0.5 ms."""
BLOCK = 5.0  # s; the disturbances of a drive are forgotten after that
MAX_RESIDUAL = 1e3  # typical errors; a rollout that left the road is not wronger than this
IDENTIFIED = 1.0 / 3.0
"""Of the prior that nothing measured would have: below it a standard error that the data alone
give counts as identified. The posterior has the information of the data and of its prior."""
CORRELATED = (len(READ) * BLOCK / EVERY)**-0.5
"""Read-outs of one window and windows of one block say much the same; the prior, which
is said once, is weighed against a block and not against each of its samples."""
PASSES = 2  # the second one with the residual sizes of the first

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class JointFit:
    """fits: one per sub-model; names and covariance (k, k) of all free parameters together.

    nuisance: by full name, what moved within the errors with which it was known and is part of
    ``vehicle``. rmse: of CHANNELS [m/s, m/s, rad/s] over all windows and read-outs, before
    and after.
    """

    vehicle: Vehicle
    fits: dict[str, Fit]
    names: tuple[str, ...]
    covariance: FloatArray
    windows: int
    before: tuple[float, ...]
    after: tuple[float, ...]
    nuisance: Mapping[str, Estimate]


def free_names(base: Vehicle, submodels: Sequence[str]) -> tuple[str, ...]:
    """Names "group.key" of what the fit moves."""
    keys = {**FREE, "tyres": AXLE} if isinstance(base.tyres, AxleTyres) else FREE
    wanted = [g for g in keys if g in submodels and not (g == "tyres" and base.kind == "kinematic")]
    return tuple(f"{group}.{key}" for group in wanted for key in keys[group])


def fit_jointly(problem: Problem, base: Vehicle, submodels: Sequence[str] = tuple(FREE),
                progress: Progress | None = None,
                known: Mapping[str, float] | None = None) -> JointFit:
    """The parameters of the sub-models that predict the windows best, starting at ``base``.

    Residuals in units of their typical size, soft L1 beyond two of these; a
    prior around ``base``, weak but for the standard errors that are ``known``
    by name; standard errors by blocks. Raises UsageError where the base has a
    0 that would have to move by factors.
    """
    begin = time.process_time()
    results = free_names(base, submodels)
    present = flat_names(base)
    names = (*results, *(n for n in NUISANCE if n in present and (known or {}).get(n, 0.0) > 0.0))
    space = Coordinates(base, names, known or {})
    work = _Work(problem, space, base.body.l_r, progress)
    scale = np.broadcast_to(np.array(SCALE)[:, None], (*problem.measured.shape[:2], 1))
    x = space.first
    for _ in range(PASSES):
        data = work.solve(x, scale)
        x = data.x
        scale = _typical(work.error(x))
    data = work.two_sided(data, scale)
    relative = _covariance(data, problem) + fixed_value_covariance(
        data, _held_columns(problem, names, data, space, scale), prior=CORRELATED**-2)
    slope = space.slope(x)
    covariance = relative * np.outer(slope, slope)
    vehicle = space.vehicle(x)
    std = np.sqrt(np.diag(relative))
    without_prior = 1.0 / np.sqrt(np.maximum(std**-2 - 1.0, np.finfo(float).tiny))
    identified = ((without_prior * slope < IDENTIFIED * space.usual(x))
                  & work.agrees(data, scale, std))
    cpu = time.process_time() - begin
    before, after = _rmse(work.error(np.zeros(len(names)))), _rmse(work.error(x))
    note = f"{len(problem)} stretches of {HORIZON:g} s predicted; error (rms) " + ", ".join(
        f"{c} {b:.3g} -> {a:.3g} {u}"
        for c, b, a, u in zip(CHANNELS, before, after, UNITS, strict=True))
    fits = {s: _submodel(s, vehicle, names, covariance, identified, data, cpu, note)
            for s in FREE if any(name.startswith(f"{s}.") for name in names)}
    errors, count = np.sqrt(np.diag(covariance)), len(results)
    nuisance = {name: Estimate(float(value(vehicle, name)), float(errors[i]), unit(vehicle, name))
                for i, name in enumerate(names) if i >= count}
    return JointFit(vehicle, fits, results, covariance[:count, :count], len(problem), before,
                    after, nuisance)


Used = list[tuple[Recording, Grid]]


def fit_from_recordings(recordings: Sequence[Recording], base: Vehicle,
                        submodels: Sequence[str] = tuple(FREE),
                        reference: Reference | None = None, progress: Progress | None = None,
                        known: Mapping[str, float] | None = None
                        ) -> tuple[JointFit, Used, dict[str, tuple[str, ...]]]:
    """(fit, recordings used with their grids, reasons by file of those that were not).

    Errors: RecordingError when no recording holds a window to predict.
    """
    used, unused = Used(), dict[str, tuple[str, ...]]()
    for r in recordings:
        try:
            if r.mocap is None:
                raise RecordingError("no motion capture: a joint fit predicts the measured motion")
            g = grid(r, reference, base.body.l_r)
            Problem.of([g])
        except RecordingError as err:
            unused[str(r.path)] = (f"not used: {err.what}",)
        else:
            used.append((r, g))
    if not used:
        reasons = "; ".join(dict.fromkeys(why for (why,) in unused.values()))
        raise RecordingError("none of these recordings can be predicted", found=reasons,
                             expected="motion capture of a moving car",
                             remedy="without --joint the sub-models are fitted one by one")
    waits = tuple(0.0 if r.commands is None else PWM_WAIT_STD for r, _ in used)
    problem = replace(Problem.of([g for _, g in used]), waits=waits)
    return fit_jointly(problem, base, submodels, progress, known), used, unused


class _Work:
    """Residuals and Jacobian over the coordinates."""

    def __init__(self, problem: Problem, space: Coordinates, l_r: float,
                 progress: Progress | None) -> None:
        """l_r: from the rear axle to the point of the measured motion [m]."""
        self._problem, self._space = problem, space
        self._l_r = l_r
        self._progress, self._rounds = progress, 0

    def error(self, x: FloatArray) -> FloatArray:
        vehicle = self._space.vehicle(x)
        return (self._problem.predict(vehicle, vehicle.body.l_r - self._l_r)
                - self._problem.measured)

    def solve(self, x0: FloatArray, scale: FloatArray) -> Solution:
        space = self._space

        def residual(x: FloatArray) -> FloatArray:
            return self._residual(x, scale)

        def jacobian(x: FloatArray, r: FloatArray) -> FloatArray:
            self._tell()
            return self._jacobian(x, scale)

        return descend(residual, jacobian, x0, space.low, space.high, robust=LOSS_SCALE,
                       prior=CORRELATED**-2)

    def two_sided(self, data: Solution, scale: FloatArray) -> Solution:
        """The solution with residuals and slopes of the newest scale, at its end."""
        r = self._residual(data.x, scale)
        return replace(data, residual=r, jacobian=self._jacobian(data.x, scale),
                       weight=soft_l1_weight(r, LOSS_SCALE))

    def agrees(self, data: Solution, scale: FloatArray, std: FloatArray) -> BoolArray:
        """Whether the loss at two standard errors (k,) is what the slopes say."""
        space = self._space
        return agrees_with_quadratic(lambda x: self._residual(x, scale), data, std, space.low,
                               space.high, robust=LOSS_SCALE, prior=CORRELATED**-2)

    def _residual(self, x: FloatArray, scale: FloatArray) -> FloatArray:
        error = np.clip(self.error(x) / scale, -MAX_RESIDUAL, MAX_RESIDUAL)
        return np.asarray(np.nan_to_num(error, nan=MAX_RESIDUAL).ravel())

    def _jacobian(self, x: FloatArray, scale: FloatArray) -> FloatArray:
        """Two-sided differences (n, k); one-sided at a bound."""
        space, columns = self._space, []
        for i, name in enumerate(space.names):
            step = TIMING_STEP / space.width(i) if name.startswith("delay.") else STEP
            up, down = x.copy(), x.copy()
            up[i] = min(x[i] + step, space.high[i])
            down[i] = max(x[i] - step, space.low[i])
            columns.append((self._residual(up, scale) - self._residual(down, scale))
                           / (up[i] - down[i]))
        return np.stack(columns, axis=1)

    def _tell(self) -> None:
        self._rounds += 1
        if self._progress is not None:
            self._progress(1.0 - 0.8**self._rounds, f"joint fit, round {self._rounds}")


def _held_columns(problem: Problem, names: tuple[str, ...], data: Solution, space: Coordinates,
                  scale: FloatArray) -> FloatArray:
    """Changes (n, h) of the residuals by one standard error of marker frame, latency and waits.

    The measured v_y changes by -omega per m of L_x, by v_x per rad of theta, and v_x by omega
    per m of L_y. Poses that came later than was measured make both delays shorter alike. So does
    a longer wait of all commands of one recording, in its windows alone.
    """
    columns = []
    along, _, turning = np.moveaxis(problem.measured, 1, 0)
    for channel, series, which in ((1, -turning, 0), (1, along, 1), (0, turning, 2)):
        change = np.zeros_like(problem.measured)
        change[:, channel] = series * problem.frame_errors(which)
        columns.append((change / scale).ravel())
    later = np.zeros(len(data.residual))  # per s
    for i, name in enumerate(names):
        if name in ("delay.steering_s", "delay.throttle_s"):
            later += data.jacobian[:, i] / space.width(i)
    columns.append(POSE_LATENCY_STD * later)
    recording, _ = stretches(problem.parts, BLOCK)
    for i, wait in enumerate(problem.waits):
        inside = np.broadcast_to(recording == i, problem.measured.shape).ravel()
        columns.append(np.where(inside, wait * later, 0.0))
    return np.stack(columns, axis=1)


def _typical(error: FloatArray) -> FloatArray:
    """Robust size (len(READ), 3, 1) of the errors (len(READ), 3, n)."""
    return np.asarray(MAD_TO_SIGMA * np.median(np.abs(error), axis=2, keepdims=True) + 1e-6)


def _rmse(error: FloatArray) -> tuple[float, ...]:
    return tuple(np.sqrt(np.mean(error**2, axis=(0, 2))).tolist())


def _covariance(data: Solution, problem: Problem) -> FloatArray:
    """By blocks: whole recordings where there are many, else stretches; prior included.

    A direction that the data do not see keeps the prior's variance, 1.
    """
    recording, stretch = stretches(problem.parts, BLOCK)
    block = recording if len(np.unique(recording)) >= MIN_RECORDING_BLOCKS else stretch
    repeated = np.broadcast_to(block, (data.residual.size // len(block), len(block))).ravel()
    return block_covariance(data, repeated, prior=CORRELATED**-2, count_parameters=True)


def _submodel(name: str, vehicle: Vehicle, names: tuple[str, ...], covariance: FloatArray,
              identified: BoolArray, data: Solution, cpu: float, note: str) -> Fit:
    mine = [i for i, full in enumerate(names) if full.startswith(f"{name}.")]
    std = np.sqrt(np.diag(covariance))
    estimates = {names[i].partition(".")[2]: Estimate(
        float(value(vehicle, names[i])), float(std[i]), unit(vehicle, names[i]),
        bool(identified[i]) and (name != "delay" or float(std[i]) < TIME_KNOWN)) for i in mine}
    # no delay and no lag are answers, not walls that the fit ran into; their upper ends are
    stopped = tuple(names[i].partition(".")[2] for i in mine
                    if data.at_bound[i] and (
                        name != "delay" or value(vehicle, names[i]) > BOUND_TOLERANCE))
    return Fit(name, estimates, covariance[np.ix_(mine, mine)], len(data.residual), data.rmse,
               "typical error", data.converged, stopped, cpu,
               (note, "one fit of all: its covariance across the sub-models is in the file"))
