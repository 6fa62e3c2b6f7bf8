"""Delay and lag of the steering: yaw rate against command, on the true times.

For every delay the yaw rate is regressed on a cubic of the delayed command
times speed, each recording by itself: the delay of the smallest residual is
that of the largest correlation, with no grid of samples between. With fast
changes a first-order lag is told apart from the delay; a slow sine shows only
their sum.
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
from dart_lab.identification.submodels.turning import Turning

LOW, HIGH = (-0.1, 0.0), (0.5, 0.4)  # s, delay and lag
STEP = 0.008  # s; smaller differences of a staircase are noise
COARSE = np.arange(0.0, 0.401, 0.025)  # s
SEPARATE = 0.03  # s; a delay and a lag known better than this are two things
INDEPENDENT = 0.1  # share of the delay's effect that a lag cannot have
SYSTEMATIC = 0.005  # s; what the yaw motion taken off and the phase of messages may be wrong


@dataclass(frozen=True, slots=True)
class Timing:
    """values (2,): delay, lag [s]; covariance (2, 2); apart: both are identifiable.

    command_s: from the command itself, as one delay [s].
    """

    values: FloatArray
    covariance: FloatArray
    apart: bool
    notes: tuple[str, ...]
    n: int
    rmse: float
    converged: bool
    command_s: float = 0.0

    def held(self, hold: float, what: str) -> Timing:
        """The same for a replay that holds each logged row, ``hold`` [s] late in the mean.

        The delay does not go below zero, the sum is kept: what a log is late
        no model can undo.
        """
        delay, lag = (self.values - np.array([hold, 0.0])).tolist()
        note = (f"{what}: counted from the command itself to the motion as the sensor shows it "
                "(its own age included)" if hold == 0.0 else
                f"{what}: the values are for a replay that holds logged rows, {hold:.3f} s less "
                "than from the command itself to the motion as the sensor shows it (its own age "
                "included), because a row is that late in the mean")
        if delay < 0.0:
            note += f"; the delay would be {delay:+.3f} s, so 0, and the lag takes the rest"
            delay, lag = 0.0, max(0.0, delay + lag)
        return replace(self, values=np.array([delay, lag]), notes=(*self.notes, note))


def steering_timing(series: Sequence[Turning]) -> Timing:
    """Fit over all recordings, each with its own steering map, trim and gyro offset."""
    coarse = [np.concatenate([_left(s, d, 0.0) for s in series]) for d in COARSE]
    start = float(COARSE[int(np.argmin([r @ r for r in coarse]))])
    scale = [max(float(np.std(_left(s, start, 0.0))), 1e-6) for s in series]
    block = select_blocks(*pool_blocks([s.block for s in series]))

    def residual(x: FloatArray) -> FloatArray:
        lag = max(float(x[1]), 0.0) if len(x) > 1 else 0.0
        return np.concatenate([_left(s, float(x[0]), lag) / k
                               for s, k in zip(series, scale, strict=True)])

    total = _solve(residual, [start], block)
    joint = min((_solve(residual, [max(float(total[0].x[0]) - lag, 0.0), lag], block)
                 for lag in (0.02, 0.1)), key=lambda found: found[0].rmse)
    solution, covariance = joint
    covariance = covariance + SYSTEMATIC**2 * np.eye(2)
    std = np.sqrt(np.diag(covariance))
    independent = collinearity(solution)
    apart = bool((std < SEPARATE).all() and independent[0] > INDEPENDENT)
    said = _notes(series, total, joint, apart)
    rmse = float(np.sqrt(np.mean(np.concatenate(
        [_left(s, *map(float, solution.x)) for s in series]) ** 2)))
    values = solution.x if apart else np.array([float(total[0].x[0]), 0.0])
    timing = Timing(values, covariance, apart, said, len(solution.residual), rmse,
                    solution.converged if apart else total[0].converged, float(total[0].x[0]))
    return timing.held(float(np.mean([s.command.hold for s in series])), "steering")


def _left(s: Turning, delay: float, lag: float) -> FloatArray:
    """Yaw rate (n,) [rad/s] that no cubic map of the command with slip and offset explains."""
    c = s.answered(delay, lag)
    v = s.speed
    shape = np.column_stack([v, v * c, v * c * c, v * c**3, v**3 * c, np.ones_like(v)])
    return np.asarray(s.yaw_rate - shape @ np.linalg.lstsq(shape, s.yaw_rate, rcond=None)[0])


def _solve(residual: Callable[[FloatArray], FloatArray], start: list[float], block: IntArray
           ) -> tuple[Solution, FloatArray]:
    def slope(x: FloatArray) -> FloatArray:
        columns = []
        for i in range(len(x)):
            up, down = x.copy(), x.copy()
            up[i] += STEP
            down[i] = max(down[i] - STEP, LOW[i])
            columns.append((residual(up) - residual(down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)

    k = len(start)
    solution = least_squares(residual, start, (LOW[:k], HIGH[:k]), jacobian=slope,
                             robust=SOFT_L1_STDS,
                             tolerance=1e-5)
    return solution, leverage_covariance(solution, block)


def _notes(series: Sequence[Turning], total: tuple[Solution, FloatArray],
           joint: tuple[Solution, FloatArray], apart: bool) -> tuple[str, ...]:
    sources = " and ".join(sorted({s.source for s in series}))
    std = np.sqrt(np.diag(joint[1]))
    yaw = float(np.mean(np.concatenate([s.yaw_lag for s in series])))
    out = [f"steering by {sources}, {len(series)} recording(s), from the command itself: as one "
           f"pure delay {total[0].x[0]:.3f} +- {np.sqrt(total[1][0, 0]):.3f} s; as delay and lag "
           f"{joint[0].x[0]:.3f} +- "
           f"{std[0]:.3f} and {joint[0].x[1]:.3f} +- {std[1]:.3f} s",
           f"{yaw:.3f} s of the car's own yaw motion taken off (the base's tyres); "
           f"{SYSTEMATIC} s of every error stands for what is wrong with that"]
    if any(s.source == "gyro" for s in series):  # of a run every value has its own time
        out.append("gyro: the age of a message (0 to 0.1 s) is in these values")
    if not apart:
        out.append("steering: delay and lag cannot be told apart by these data (slow or few "
                   "changes); their sum is given as a pure delay")
    return tuple(out)
