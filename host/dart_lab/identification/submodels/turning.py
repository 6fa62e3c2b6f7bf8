"""Yaw rate and steering command of one recording, for the timing of the steering.

The response is the mocap's yaw rate if there is one (the command is then smoothed by the same
derivative window), else the gyro's. The delay of the car's own yaw motion is subtracted with the
tyres of the base model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.check.uses import MIN_DELAY_MESSAGES as LEAST
from dart_hal.recording.check.uses import MIN_DELAY_SPEED as MIN_SPEED
from dart_hal.recording.check.uses import MIN_STEERING_CHANGES as MIN_CHANGES
from dart_hal.recording.check.uses import MIN_STEERING_SPREAD as MIN_SPREAD
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import AxleTyres, Vehicle
from dart_hal.vehicle.fitting.covariance import split_into_blocks
from dart_lab.identification.prediction.commands import LoggedCommand, message_step, steering_of
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import (
    BLOCK_LENGTH,
    ENCODER_WINDOW,
    MOCAP_KERNEL,
    SLOW_MOCAP_KERNEL,
    mocap_grid,
)

# [m/s2] The tyres are nonlinear beyond it.
MAX_RESPONSE_LATERAL = 4.0
# [s] Tyres with a larger yaw lag oversteer, which slow inputs do not show.
MAX_YAW_LAG = 0.03
# Samples of the mocap grid from one yaw rate to the next.
YAW_RATE_STRIDE = 5


@dataclass(frozen=True, slots=True)
class YawResponse:
    """Yaw rate of one recording and the steering command before it.

    t (n,) [s], yaw_rate [rad/s], speed [m/s]; yaw_lag (n,) [s] of the car's own motion; command:
    on the clock of t; window (j,): weights of the sensor's window over command cells of 10 ms,
    of which the first is ``first`` cells from the sample; block (n,).
    """

    name: str
    t: FloatArray
    yaw_rate: FloatArray
    speed: FloatArray
    yaw_lag: FloatArray
    command: LoggedCommand
    window: FloatArray
    first: int
    block: IntArray
    source: str

    def delayed_command(self, delay: float, lag: float) -> FloatArray:
        """Return the command (n,) at the yaw rates: delayed, lagged and averaged by the window."""
        begin = float(self.command.t[0]) - 1.0
        n = int((self.t[-1] - begin) / SAMPLE) + 2 * len(self.window) + 2
        cells = self.command.on_grid(begin, n, delay, lag)
        smooth = np.correlate(cells, self.window, mode="valid")
        times = begin + SAMPLE * (np.arange(len(smooth)) - self.first)
        return np.asarray(np.interp(self.t - self.yaw_lag, times, smooth))


def read_yaw_response(recording: Recording, reference: Reference | None, base: Vehicle,
                      ledger: Ledger) -> YawResponse | None:
    """Read the yaw response; None (reason in the ledger) if it has no information on a delay."""
    try:
        g = mocap_grid(recording, reference)
    except RecordingError:
        g = None
    m = recording.messages
    command = steering_of(recording, m.arrival if g is not None else m.t)
    if g is not None and recording.mocap is not None:
        slow = float(np.median(np.diff(recording.mocap.t))) > 0.03
        pick = slice(0, None, YAW_RATE_STRIDE)
        t = g.t[pick]
        speed = g.v_x[pick]
        yaw_rate = g.omega[pick]
        good = ~g.bad[pick]
        weight = (SLOW_MOCAP_KERNEL if slow else MOCAP_KERNEL).weight * SAMPLE
        window = np.cumsum(weight[::-1])[::-1][1:]
        source = "mocap"
        first = -(len(weight) // 2)
    elif recording.encoder == "ok":
        t = m.t
        yaw_rate = m.yaw_rate
        source = "gyro"
        if recording.of_means:
            # Speed and yaw rate are means of the same step.
            cells = max(round(message_step(recording) / SAMPLE), 1)
            source = "gyro of a run"
            speed = m.speed
            window = np.full(cells, 1.0 / cells)
            first = -cells
        else:
            speed = np.interp(m.t, m.t - 0.5 * ENCODER_WINDOW, m.speed)
            window = np.array([0.5, 0.5])
            first = -1
        good = np.isfinite(speed) & np.isfinite(yaw_rate)
    else:
        ledger.add(recording.name, 0, len(m), ["delay: no yaw rate with a speed"])
        return None
    least = MIN_SPEED * recording.scale.speed
    use = good & (speed > least) & (np.abs(speed * yaw_rate) < MAX_RESPONSE_LATERAL)
    why = _why_too_calm(command, t, use, least)
    ledger.add(recording.name, 0 if why else int(use.sum()),
               len(use) if why else int((~use).sum()), [f"delay: {why}"] if why else [])
    if why:
        return None
    group = np.concatenate([[0], np.cumsum(np.diff(t[use]) > 0.5)]).astype(np.int64)
    return YawResponse(recording.name, t[use], yaw_rate[use], speed[use],
                       yaw_lag(base, speed[use]), command, window, first,
                       split_into_blocks(t[use], group, BLOCK_LENGTH), source)


def _why_too_calm(command: LoggedCommand, t: FloatArray, use: BoolArray, least: float) -> str:
    if use.sum() < LEAST:
        return f"fewer than {LEAST} samples above {least:.2g} m/s"
    index = np.clip(np.searchsorted(command.t, t[use], side="right") - 1, 0, None)
    held = command.value[index]
    changes = int((np.diff(held) != 0.0).sum())
    if changes < MIN_CHANGES or float(np.std(held)) < MIN_SPREAD:
        return "the steering hardly changes while the car drives: no delay can be measured"
    return ""


def yaw_lag(base: Vehicle, speed: FloatArray) -> FloatArray:
    """Compute the delay (n,) [s] of the yaw rate behind the wheels, for slow inputs.

    It is the linear bicycle's: the transfer function omega(s)/delta(s) at low frequency is
    k (1 + T_z s) / (1 + c/K s + ...), whose delay is c/K - T_z with damping c and stiffness K.
    """
    b = base.body
    p = base.tyres
    if isinstance(p, AxleTyres):
        front = p.front_D * p.front_C * p.front_B * b.front_load
        rear = p.rear_D * p.rear_C * p.rear_B * b.rear_load
    else:
        front = p.front_D * p.front_C * p.front_B
        rear = p.rear_cornering_stiffness
    stiff = b.wheelbase**2 * front * rear + b.mass * speed**2 * (b.l_r * rear - b.l_f * front)
    damping = b.mass * (b.l_f**2 * front + b.l_r**2 * rear) + b.yaw_inertia * (front + rear)
    lead = b.mass * speed * b.l_f / (b.wheelbase * rear)
    least = 0.2 * b.wheelbase**2 * front * rear
    return np.asarray(np.clip(damping * speed / np.maximum(stiff, least) - lead, 0.0, MAX_YAW_LAG))
