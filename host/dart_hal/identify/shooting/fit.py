"""All sub-models at once: Gauss-Newton on the predictions, with weak priors and bounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.identify.fit import Estimate, Fit
from dart_hal.identify.solve import EDGE, Solution, block_covariance
from dart_hal.types import FloatArray
from dart_hal.vehicle.flat import bounds, unit, value, with_values
from dart_hal.vehicle.parameters import AxleTyres, Vehicle

from .descent import Descent, descend
from .problem import CHANNELS, EVERY, HORIZON, READ, Problem

FREE = {
    "friction": ("a", "b", "c"),
    "motor": ("d", "e", "g"),
    "steering": ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right"),
    "delay": ("steering_s", "throttle_s", "steering_lag_s", "throttle_lag_s"),
    "tyres": ("front_D", "front_B", "rear_cornering_stiffness"),
}
"""What moves: mass and inertia never (a fit shrinks them to mimic noise), and of the front
tyre two of four, because C and E are told apart from D only beyond the grip limit."""
AXLE = ("front_D", "front_B", "rear_D", "rear_B")
PRIOR = {"steering.s0": 0.1, "motor.g": 0.1, "delay": 0.1}
RELATIVE = 0.7
"""One standard deviation of the weak prior: these absolute ones, else a share of the value."""
SCALE = (0.15, 0.05, 0.4)  # m/s, m/s, rad/s; typical errors of a first model after a second
ROBUST = 2.0  # typical errors from where on a residual counts less than its square
STEP = 1e-3  # of the prior, one-sided
TIMING_STEP = 4e-3  # s, both sides: a delay of held commands is smooth only beyond their grid
BLOCK = 5.0  # s; the disturbances of a drive are forgotten after that
MANY = 8  # recordings from which on each is one block
SPUN = 1e3  # typical errors; a rollout that left the road is not wronger than this
TOLD = 0.5  # of the prior: a smaller standard error counts as identified
ALIKE = (len(READ) * HORIZON / EVERY)**-0.5
"""Read-outs of one window and overlapping windows repeat each other; the prior, which
is said once, is weighed against a sample and not against its copies."""
FIRST_LAG = 0.04  # s; where a lag starts that the base model lacks: at 0 it has no slope
PASSES = 2  # the second one with the residual sizes of the first

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class JointFit:
    """fits: one per sub-model; names and covariance (k, k) of all free parameters together.

    rmse: of CHANNELS [m/s, m/s, rad/s] over all windows and read-outs, before
    and after.
    """

    vehicle: Vehicle
    fits: dict[str, Fit]
    names: tuple[str, ...]
    covariance: FloatArray
    windows: int
    before: tuple[float, ...]
    after: tuple[float, ...]


def free_names(base: Vehicle, submodels: Sequence[str]) -> tuple[str, ...]:
    """Names "group.key" of what the fit moves."""
    keys = {**FREE, "tyres": AXLE} if isinstance(base.tyres, AxleTyres) else FREE
    return tuple(f"{group}.{key}" for group in keys if group in submodels for key in keys[group])


def fit_jointly(problem: Problem, base: Vehicle, submodels: Sequence[str] = tuple(FREE),
                progress: Progress | None = None) -> JointFit:
    """The parameters of the sub-models that predict the windows best, starting at ``base``.

    Residuals in units of their typical size, soft L1 beyond two of these; a
    weak prior around ``base``; standard errors by blocks.
    """
    begin = time.process_time()
    names = free_names(base, submodels)
    start = np.array([value(base, name) for name in names])
    prior = np.array([_prior(name, number) for name, number in zip(names, start, strict=True)])
    work = _Work(problem, base, names, prior, progress)
    scale = np.broadcast_to(np.array(SCALE)[:, None], (*problem.measured.shape[:2], 1))
    x = np.array([FIRST_LAG / width if "_lag_s" in name and number == 0.0 else 0.0
                  for name, number, width in zip(names, start, prior, strict=True)])
    for _ in range(PASSES):
        found = work.solve(x, scale)
        x = found.x
        scale = _typical(work.error(x))
    vehicle = work.vehicle(x)
    data = Solution(x, found.residual, found.jacobian, found.weight, found.converged,
                    (x - work.low < EDGE) | (work.high - x < EDGE))
    covariance = _covariance(data, problem) * np.outer(prior, prior)
    cpu = time.process_time() - begin
    fits = {s: _submodel(s, vehicle, names, covariance, prior, data, cpu)
            for s in FREE if s in submodels}
    return JointFit(vehicle, fits, names, covariance, len(problem),
                    _rmse(work.error(np.zeros(len(names)))), _rmse(work.error(x)))


class _Work:
    """Residuals and Jacobian over parameters in units of their prior, from ``base`` on."""

    def __init__(self, problem: Problem, base: Vehicle, names: tuple[str, ...],
                 prior: FloatArray, progress: Progress | None) -> None:
        self._problem, self._base, self._names, self._prior = problem, base, names, prior
        self._start = np.array([value(base, name) for name in names])
        self._limits = np.array([bounds(base, name) for name in names]).T
        self.low, self.high = (self._limits - self._start) / prior
        self._progress, self._rounds = progress, 0

    def vehicle(self, x: FloatArray) -> Vehicle:
        # the way there and back through the units of the prior may miss a bound by one digit
        numbers = np.clip(self._start + self._prior * x, *self._limits)
        return with_values(self._base, dict(zip(self._names, numbers.tolist(), strict=True)))

    def error(self, x: FloatArray) -> FloatArray:
        return self._problem.predict(self.vehicle(x)) - self._problem.measured

    def solve(self, x0: FloatArray, scale: FloatArray) -> Descent:
        def residual(x: FloatArray) -> FloatArray:
            error = np.nan_to_num(self.error(x) / scale, nan=SPUN, posinf=SPUN, neginf=-SPUN)
            return np.asarray(np.clip(error, -SPUN, SPUN).ravel())

        def jacobian(x: FloatArray, r: FloatArray) -> FloatArray:
            self._tell()
            columns = []
            for i, name in enumerate(self._names):
                timing = name.startswith("delay.")
                step = TIMING_STEP / self._prior[i] if timing else STEP
                up, down = x.copy(), x.copy()
                up[i] = x[i] + step if x[i] + step <= self.high[i] else x[i] - step
                down[i] = max(x[i] - step, self.low[i]) if timing else x[i]
                below = residual(down) if timing else r
                columns.append((residual(up) - below) / (up[i] - down[i]))
            return np.stack(columns, axis=1)

        return descend(residual, jacobian, x0, self.low, self.high, robust=ROBUST,
                       prior=ALIKE**-2)

    def _tell(self) -> None:
        self._rounds += 1
        if self._progress is not None:
            self._progress(1.0 - 0.8**self._rounds, f"joint fit, round {self._rounds}")


def _prior(name: str, number: float) -> float:
    group = name.partition(".")[0]
    return PRIOR.get(name, PRIOR.get(group, RELATIVE * abs(number)))


def _typical(error: FloatArray) -> FloatArray:
    """Robust size (len(READ), 3, 1) of the errors (len(READ), 3, n)."""
    return np.asarray(1.4826 * np.median(np.abs(error), axis=2, keepdims=True) + 1e-6)


def _rmse(error: FloatArray) -> tuple[float, ...]:
    return tuple(np.sqrt(np.mean(error**2, axis=(0, 2))).tolist())


def _covariance(data: Solution, problem: Problem) -> FloatArray:
    """By blocks: whole recordings where there are many, else stretches; prior included.

    A direction that the data do not see keeps the prior's variance, 1.
    """
    many = len(np.unique(problem.owner)) >= MANY
    block = problem.owner if many else problem.blocks(BLOCK)
    repeated = np.broadcast_to(block, (data.residual.size // len(block), len(block))).ravel()
    return block_covariance(data, repeated, prior=ALIKE**-2)


def _submodel(name: str, vehicle: Vehicle, names: tuple[str, ...], covariance: FloatArray,
              prior: FloatArray, data: Solution, cpu: float) -> Fit:
    mine = [i for i, full in enumerate(names) if full.startswith(f"{name}.")]
    std = np.sqrt(np.diag(covariance))
    estimates = {names[i].partition(".")[2]: Estimate(
        float(value(vehicle, names[i])), float(std[i]), unit(vehicle, names[i]),
        bool(std[i] < TOLD * prior[i])) for i in mine}
    # no delay and no lag are answers, not walls that the fit ran into
    stopped = tuple(names[i].partition(".")[2] for i in mine
                    if data.at_bound[i] and name != "delay")
    return Fit(name, estimates, covariance[np.ix_(mine, mine)], len(data.residual), data.rmse,
               f"typical errors of {', '.join(CHANNELS)}", data.converged, stopped, cpu,
               ("one of a joint fit: its covariance with the other sub-models is in the file",))
