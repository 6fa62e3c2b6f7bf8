"""Delay and lag of the steering: yaw rate against command, on the true times.

1. For a trial (delay, lag) the command is delayed and filtered, u(t).
2. Each recording by itself: omega = v (c0 + c1 u + c2 u^2 + c3 u^3) + c4 v^3 u + c5 by linear
   least squares. The smallest residual is the largest correlation, without a grid of samples.
3. Gauss-Newton over the delay alone, then over delay and lag together.
4. Delay and lag are both reported only if their errors are small and their effects differ. With
   fast changes they can be separated; a slow sine shows only their sum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import (
    collinearity,
    leverage_covariance,
    pool_blocks,
    select_blocks,
)
from dart_hal.vehicle.fitting.least_squares import Solution, least_squares
from dart_hal.vehicle.fitting.robust import SOFT_L1_STDS
from dart_lab.identification.submodels.turning import YawResponse

# Bounds of (delay, lag) [s].
MIN_TIMING = (-0.1, 0.0)
MAX_TIMING = (0.5, 0.4)
# [s] Step of the central differences. The command is a staircase: smaller steps measure noise.
SLOPE_STEP = 0.008
# [s] Trial delays of the first guess.
DELAY_GRID = np.arange(0.0, 0.401, 0.025)
# [s] Delay and lag are separable below this standard error.
MAX_SEPARABLE_STD = 0.03
# Least share of the delay's effect on the residuals that no lag can have.
MIN_INDEPENDENT_DELAY = 0.1
# [s] Errors of delay and lag from the subtracted yaw motion and the phase of the messages: on 40
# simulated cars the lag was off by 0.011 s.
SYSTEMATIC_TIME_STD = np.array([0.005, 0.010])


@dataclass(frozen=True, slots=True)
class ActuatorTiming:
    """Delay and lag of one actuator.

    values (2,): delay, lag [s]; covariance (2, 2); separable: both are identifiable;
    command_s: delay [s] from the command itself, if all of it is a pure delay.
    """

    values: FloatArray
    covariance: FloatArray
    separable: bool
    notes: tuple[str, ...]
    n: int
    rmse: float
    converged: bool
    command_s: float = 0.0

    def subtract_hold(self, hold: float, what: str) -> ActuatorTiming:
        """Subtract the mean delay ``hold`` [s] of a replay that holds each logged row.

        The delay stays >= 0 and the sum of delay and lag is kept: no model can undo the
        delay of a log.
        """
        delay, lag = (self.values - np.array([hold, 0.0])).tolist()
        note = (f"{what}: counted from the command itself to the motion as the sensor shows it "
                "(its own age included)" if hold == 0.0 else
                f"{what}: the values are for a replay that holds logged rows, {hold:.3f} s less "
                "than from the command itself to the motion as the sensor shows it (its own age "
                "included), because a row is delayed by that in the mean")
        if delay < 0.0:
            note += f"; the delay would be {delay:+.3f} s, so 0, and the lag takes the rest"
            lag = max(0.0, delay + lag)
            delay = 0.0
        return replace(self, values=np.array([delay, lag]), notes=(*self.notes, note))


def steering_timing(series: Sequence[YawResponse]) -> ActuatorTiming:
    """Fit delay and lag to all recordings, each with its own map, trim and gyro offset."""
    # 1. Best delay of the grid, and the size of the residuals there: the unit of each recording.
    coarse = [np.concatenate([_unexplained_yaw_rate(s, d, 0.0) for s in series]) for d
              in DELAY_GRID]
    start = float(DELAY_GRID[int(np.argmin([r @ r for r in coarse]))])
    scale = [max(float(np.std(_unexplained_yaw_rate(s, start, 0.0))), 1e-6) for s in series]
    block = select_blocks(*pool_blocks([s.block for s in series]))

    def residual(x: FloatArray) -> FloatArray:
        lag = max(float(x[1]), 0.0) if len(x) > 1 else 0.0
        return np.concatenate([_unexplained_yaw_rate(s, float(x[0]), lag) / k
                               for s, k in zip(series, scale, strict=True)])

    # 2. One pure delay; 3. delay and lag, from two starts, because the loss has two minima.
    total = _fit_timing(residual, [start], block)
    joint = min((_fit_timing(residual, [max(float(total[0].x[0]) - lag, 0.0), lag], block)
                 for lag in (0.02, 0.1)), key=lambda found: found[0].rmse)
    # 4. Separable: both errors are small, and the delay's effect is not that of a lag.
    solution, covariance = joint
    covariance = covariance + np.diag(SYSTEMATIC_TIME_STD**2)
    std = np.sqrt(np.diag(covariance))
    independent = collinearity(solution)
    separable = bool((std < MAX_SEPARABLE_STD).all() and independent[0] > MIN_INDEPENDENT_DELAY)
    notes = _notes(series, total, joint, separable)
    rmse = float(np.sqrt(np.mean(np.concatenate(
        [_unexplained_yaw_rate(s, *map(float, solution.x)) for s in series]) ** 2)))
    values = solution.x
    if not separable:
        values = np.array([float(total[0].x[0]), 0.0])
        variance = float(total[1][0, 0]) + float(SYSTEMATIC_TIME_STD[0])**2
        covariance = divide_delay(values[0], variance, covariance[1, 1])
    timing = ActuatorTiming(values, covariance, separable, notes, len(solution.residual), rmse,
                            solution.converged if separable else total[0].converged,
                            float(total[0].x[0]))
    return timing.subtract_hold(float(np.mean([s.command.hold for s in series])), "steering")


def divide_delay(total: float, variance: float, lag_variance: float) -> FloatArray:
    """Return the covariance (2, 2) of delay and lag, of which only the sum is known.

    The lag is stated as 0. It may be anything up to the ``total`` [s], which has the ``variance``;
    lag_variance: of a fit of both, which may know it better.
    """
    unknown = min(total**2 / 3.0, lag_variance)
    return np.array([[variance + unknown, -unknown], [-unknown, unknown]])


def _unexplained_yaw_rate(s: YawResponse, delay: float, lag: float) -> FloatArray:
    """Return the part of the yaw rate (n,) [rad/s] that the delayed command does not explain."""
    # A cubic steering map times v, tyre slip (v^3), and the offset of the gyro.
    c = s.delayed_command(delay, lag)
    v = s.speed
    shape = np.column_stack([v, v * c, v * c * c, v * c**3, v**3 * c, np.ones_like(v)])
    return np.asarray(s.yaw_rate - shape @ np.linalg.lstsq(shape, s.yaw_rate, rcond=None)[0])


def _fit_timing(residual: Callable[[FloatArray], FloatArray], start: list[float], block: IntArray
                ) -> tuple[Solution, FloatArray]:
    def slope(x: FloatArray) -> FloatArray:
        columns = []
        for i in range(len(x)):
            up = x.copy()
            down = x.copy()
            up[i] += SLOPE_STEP
            down[i] = max(down[i] - SLOPE_STEP, MIN_TIMING[i])
            columns.append((residual(up) - residual(down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)

    k = len(start)
    solution = least_squares(residual, start, (MIN_TIMING[:k], MAX_TIMING[:k]), jacobian=slope,
                             robust=SOFT_L1_STDS, tolerance=1e-5)
    return solution, leverage_covariance(solution, block)


def _notes(series: Sequence[YawResponse], total: tuple[Solution, FloatArray],
           joint: tuple[Solution, FloatArray], separable: bool) -> tuple[str, ...]:
    sources = " and ".join(sorted({s.source for s in series}))
    std = np.sqrt(np.diag(joint[1]))
    yaw = float(np.mean(np.concatenate([s.yaw_lag for s in series])))
    out = [f"steering by {sources}, {len(series)} recording(s), from the command itself: as one "
           f"pure delay {total[0].x[0]:.3f} +- {np.sqrt(total[1][0, 0]):.3f} s; as delay and lag "
           f"{joint[0].x[0]:.3f} +- "
           f"{std[0]:.3f} and {joint[0].x[1]:.3f} +- {std[1]:.3f} s",
           f"{yaw:.3f} s of the car's own yaw motion subtracted (the base's tyres): "
           f"{SYSTEMATIC_TIME_STD[0]:g} s of the delay's error and "
           f"{SYSTEMATIC_TIME_STD[1]:g} s of the lag's"]
    # In an own run every value has its own time; other logs only have that of the message.
    if any(s.source == "gyro" for s in series):
        out.append("gyro: the age of a message (0 to 0.1 s) is in these values")
    if not separable:
        out.append("steering: delay and lag cannot be separated by these data (slow or few "
                   "changes); their sum is given as a pure delay")
    return tuple(out)
