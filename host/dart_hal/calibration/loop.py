"""Fit the angle at the middle of the backlash loop to windows of steady driving, per level.

The wheels follow the servo like a peg in a slot of width b: they touch the lower flank after a rise
and the upper one after a fall, and they stay where they are until the slot has moved that far. With
one angle delta per level, and one b and one understeer kappa for all windows, window i measures

    angle_i = delta_k -+ b/2 - kappa v_i^2 sin(2 delta_k)/2 + noise

where k is the level at which the wheels were last moved. Sweeps in both directions at two speeds
separate the parameters: b is even and the slip odd in delta.

The noise comes mostly from the servo: after each move it rests a few tenths of a count from its
target. That is an error of the pulse, so it scales with the slope of the map. Its size is estimated
with the other parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Estimate, FloatArray, IntArray

# rad, one sigma around 0.
BACKLASH_PRIOR = 0.1
# s2/m2, one sigma around 0: 1:10 cars under- or oversteer.
UNDERSTEER_STD = 0.06
# s2/m2, mean and one sigma.
KAPPA_PRIOR = (0.0, UNDERSTEER_STD)
# rad; gyro resolution and speed loop within one window.
STD_FLOOR = 3e-4
# us, one sigma of the rest position of a servo; weight of this prior in windows.
REST_PRIOR = (1.0, 3.0)
LOOP_ROUNDS = 8


@dataclass(frozen=True, slots=True)
class Window:
    """One time of steady driving: command -1..1, pulse_us, angle [rad] with std, speed [m/s].

    direction: +1 the command rose before it, -1 it fell. yaw_rate [rad/s]; n frames; duration [s].
    """

    command: float
    pulse_us: float
    angle: float
    std: float
    speed: float
    yaw_rate: float
    direction: float
    n: int
    duration: float


@dataclass(frozen=True, slots=True)
class Systematic:
    """Errors common to all windows: relative std of l omega/v, std of the gyro bias [rad/s]."""

    scale: float
    bias: float


@dataclass(frozen=True, slots=True)
class LoopFit:
    """command, pulse_us, angle (k,), covariance (k, k); residual (n,) rad.

    rest_us: one sigma of the servo's rest position [us].
    """

    command: FloatArray
    pulse_us: FloatArray
    angle: FloatArray
    covariance: FloatArray
    backlash: Estimate
    kappa: Estimate
    residual: FloatArray
    rest_us: float

    @property
    def std(self) -> FloatArray:
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_loop(windows: Sequence[Window], wheelbase: float, systematic: Systematic) -> LoopFit:
    """Fit the windows, given in the order in which they were driven. wheelbase [m].

    Repeat ``LOOP_ROUNDS`` times:

    1. Design matrix for the present contact (level and side) of each window.
    2. Weighted least squares with the priors of backlash and slip.
    3. Rest position noise of the servo by restricted maximum likelihood.
    4. Contact of each window from the new angles and backlash.

    Raises CalibrationFailed if levels are missing or the map does not increase.
    """
    commands = np.array([w.command for w in windows])
    levels, first, index = np.unique(np.round(commands, 6), return_index=True,
                                     return_inverse=True)
    if len(levels) < 9:
        raise CalibrationFailed("too few steering levels were measured",
                                found=f"{len(levels)}", expected="at least 9",
                                remedy="run the procedure to its end")
    angle = np.array([w.angle for w in windows])
    speed = np.array([w.speed for w in windows])
    pulse = np.array([w.pulse_us for w in windows])[first]
    measured = np.hypot([w.std for w in windows], STD_FLOOR)
    k = len(levels)
    moved = np.asarray(index, dtype=np.int64)
    side = np.array([w.direction for w in windows])
    solution = np.zeros(k + 2)
    covariance = np.eye(k + 2)
    design = np.zeros((len(windows), k + 2))
    rest = REST_PRIOR[0]
    slope = np.full(k, 1e-3)
    for round_ in range(LOOP_ROUNDS):
        slip_angle = solution[:k][moved] if round_ else angle
        design = _design(moved, side, slip_angle, speed, k)
        std = np.hypot(measured, rest * slope[moved])
        solution, covariance = _solve(design, angle, std)
        slope = np.abs(np.gradient(solution[:k], pulse))
        leverage = np.einsum("ni,ij,nj->n", design, covariance, design) / std**2
        rest = _update_rest(angle - design @ solution, std, slope[moved], rest, leverage)
        moved, side = contact(np.asarray(index), solution[:k], solution[k], windows[0].direction)
    delta = solution[:k]
    _check_rising(levels, delta)
    # Errors that are common to all windows do not average out: rank-one terms.
    scale = 0.5 * np.sin(2.0 * delta) * systematic.scale
    bias = np.full(k, wheelbase / float(speed.mean())) * systematic.bias
    full = covariance[:k, :k] + np.outer(scale, scale) + np.outer(bias, bias)
    width = max(float(solution[k]), 0.0)
    return LoopFit(levels, pulse, delta, full,
                   Estimate(width, float(np.hypot(np.sqrt(covariance[k, k]),
                                                  width * systematic.scale)), "rad"),
                   Estimate(float(solution[k + 1]), float(np.sqrt(covariance[k + 1, k + 1])),
                            "s2/m2"),
                   angle - design @ solution, rest)


def contact(index: IntArray, delta: FloatArray, backlash: float, first_side: float
            ) -> tuple[IntArray, FloatArray]:
    """(level at which the wheels were last moved, side of the slot) of each window.

    index (n,): level of each window in driving order. side +1: the wheels are b/2 below the middle,
    as after a rise.
    """
    half = 0.5 * max(backlash, 0.0)
    moved = np.zeros(len(index), dtype=np.int64)
    side = np.zeros(len(index))
    level = int(index[0])
    flank = first_side
    position = delta[level] - flank * half
    for i, k in enumerate(index.tolist()):
        if position < delta[k] - half:
            level = k
            flank = 1.0
        elif position > delta[k] + half:
            level = k
            flank = -1.0
        position = delta[level] - flank * half
        moved[i] = level
        side[i] = flank
    return moved, side


def _design(moved: IntArray, side: FloatArray, slip_angle: FloatArray, speed: FloatArray, k: int
            ) -> FloatArray:
    """Columns: angle of each level, backlash, understeer."""
    n = len(moved)
    design = np.zeros((n, k + 2))
    design[np.arange(n), moved] = 1.0
    design[:, k] = -0.5 * side
    design[:, k + 1] = -(speed**2) * 0.5 * np.sin(2.0 * slip_angle)
    return design


def _check_rising(levels: FloatArray, delta: FloatArray) -> None:
    if np.any(np.diff(delta) <= 0.0):
        k = int(np.argmin(np.diff(delta)))
        raise CalibrationFailed(
            "the measured steering angle does not increase with the command",
            found=f"{delta[k]:+.4f} then {delta[k + 1]:+.4f} rad at commands "
                  f"{levels[k]:+.2f} and {levels[k + 1]:+.2f}",
            expected="a wider angle at each step to the left",
            likely="the servo horn slips, the servo has reached its end, or the car was touched",
            remedy="check the linkage, give the car free floor, and run it again")


def _solve(design: FloatArray, angle: FloatArray, std: FloatArray
           ) -> tuple[FloatArray, FloatArray]:
    """Least squares with the priors of backlash and slip: (solution, covariance)."""
    m = design.shape[1]
    prior = np.zeros((2, m))
    prior[0, m - 2] = 1.0 / BACKLASH_PRIOR
    prior[1, m - 1] = 1.0 / KAPPA_PRIOR[1]
    full = np.vstack([design / std[:, None], prior])
    right = np.concatenate([angle / std, [0.0, KAPPA_PRIOR[0] / KAPPA_PRIOR[1]]])
    covariance = np.linalg.pinv(full.T @ full)
    return covariance @ full.T @ right, covariance


def _update_rest(residual: FloatArray, std: FloatArray, slope: FloatArray, rest: float,
                 leverage: FloatArray) -> float:
    """Next estimate of the rest position noise of the servo [us], by restricted maximum likelihood.

    A window counts by the share of its variance that comes from the servo, and by the share that
    the fit leaves in the residual (1 - leverage). At the ends of the range, where the map is flat,
    all of the variance comes from the gyro. The result is the root of the posterior mean of the
    variance, n/(n - 2) of its best value: 1.645 standard errors then contain 90 % of a Student t.
    """
    size, weight_of_prior = REST_PRIOR
    share = (rest * slope / std) ** 2
    excess = float(share @ (residual / std) ** 2) + weight_of_prior * size**2 / rest**2
    freedom = float(share @ (1.0 - leverage)) + weight_of_prior
    return float(np.clip(rest * np.sqrt(excess / max(freedom - 2.0, 1.0)), 0.05, 10.0))


def resample(fit: LoopFit, command: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Interpolate (pulse_us, angle, covariance) at command (m,), near or between the levels.

    Monotone cubic between levels; linear beyond the last one.
    """
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(fit.command, fit.angle, extrapolate=False)
    inside = np.clip(command, fit.command[0], fit.command[-1])
    angle = np.asarray(curve(inside)) + np.asarray(curve(inside, 1)) * (command - inside)
    weights = _linear_weights(fit.command, command)
    slope = (fit.pulse_us[-1] - fit.pulse_us[0]) / (fit.command[-1] - fit.command[0])
    pulse = fit.pulse_us[0] + slope * (command - fit.command[0])
    return pulse, angle, weights @ fit.covariance @ weights.T


def _linear_weights(knots: FloatArray, x: FloatArray) -> FloatArray:
    """Weights (m, k) of linear interpolation between knots (k,) at x (m,)."""
    weights = np.zeros((len(x), len(knots)))
    left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((x - knots[left]) / (knots[left + 1] - knots[left]), 0.0, 1.0)
    rows = np.arange(len(x))
    weights[rows, left] = 1.0 - share
    weights[rows, left + 1] = share
    return weights
