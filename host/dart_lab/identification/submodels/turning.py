"""Yaw rate and steering command of one recording, for the timing of the steering.

The response is the mocap's yaw rate where there is one (its derivative's
window is put over the command as well), else the gyro. What the yaw motion of
the car itself needs is taken off with the base's tyres.
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
from dart_lab.identification.prediction.commands import Command, steering_of, step_of
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import BLOCK, MOCAP, MOCAP_SLOW, WINDOW, mocap_grid

MAX_LATERAL = 4.0  # m/s2
MAX_YAW_LAG = 0.03  # s; tyres that make it more oversteer, which slow inputs do not show
EVERY = 5  # samples of the mocap grid


@dataclass(frozen=True, slots=True)
class Turning:
    """t (n,) s, yaw_rate rad/s, speed m/s, yaw_lag (n,) s of the car's own motion.

    command: on the clock of t; window (j,): weights of the sensor's
    window over command cells that begin at ``first`` cells from the sample.
    """

    name: str
    t: FloatArray
    yaw_rate: FloatArray
    speed: FloatArray
    yaw_lag: FloatArray
    command: Command
    window: FloatArray
    first: int
    block: IntArray
    source: str

    def answered(self, delay: float, lag: float) -> FloatArray:
        """Command (n,) that the yaw rate answers: delayed, lagged, seen through the window."""
        begin = float(self.command.t[0]) - 1.0
        n = int((self.t[-1] - begin) / SAMPLE) + 2 * len(self.window) + 2
        cells = self.command.on_grid(begin, n, delay, lag)
        smooth = np.correlate(cells, self.window, mode="valid")
        times = begin + SAMPLE * (np.arange(len(smooth)) - self.first)
        return np.asarray(np.interp(self.t - self.yaw_lag, times, smooth))


def turning_of(recording: Recording, reference: Reference | None, base: Vehicle,
               ledger: Ledger) -> Turning | None:
    """None when nothing tells a delay; the reason is in the ledger."""
    try:
        g = mocap_grid(recording, reference)
    except RecordingError:
        g = None
    m = recording.messages
    command = steering_of(recording, m.arrival if g is not None else m.t)
    if g is not None and recording.mocap is not None:
        slow = float(np.median(np.diff(recording.mocap.t))) > 0.03
        pick = slice(0, None, EVERY)
        t, speed, yaw_rate, good = g.t[pick], g.v_x[pick], g.omega[pick], ~g.bad[pick]
        weight = (MOCAP_SLOW if slow else MOCAP).weight * SAMPLE
        window, source = np.cumsum(weight[::-1])[::-1][1:], "mocap"
        first = -(len(weight) // 2)
    elif recording.encoder == "ok":
        t, yaw_rate, source = m.t, m.yaw_rate, "gyro"
        if recording.of_means:  # means of one and the same step
            cells, source = max(round(step_of(recording) / SAMPLE), 1), "gyro of a run"
            speed, window, first = m.speed, np.full(cells, 1.0 / cells), -cells
        else:
            speed = np.interp(m.t, m.t - 0.5 * WINDOW, m.speed)
            window, first = np.array([0.5, 0.5]), -1
        good = np.isfinite(speed) & np.isfinite(yaw_rate)
    else:
        ledger.add(recording.name, 0, len(m), ["delay: no yaw rate with a speed"])
        return None
    use = good & (speed > MIN_SPEED) & (np.abs(speed * yaw_rate) < MAX_LATERAL)
    why = _too_calm(command, t, use)
    ledger.add(recording.name, 0 if why else int(use.sum()),
               len(use) if why else int((~use).sum()), [f"delay: {why}"] if why else [])
    if why:
        return None
    group = np.concatenate([[0], np.cumsum(np.diff(t[use]) > 0.5)]).astype(np.int64)
    return Turning(recording.name, t[use], yaw_rate[use], speed[use],
                   yaw_lag(base, speed[use]), command, window, first,
                   split_into_blocks(t[use], group, BLOCK), source)


def _too_calm(command: Command, t: FloatArray, use: BoolArray) -> str:
    if use.sum() < LEAST:
        return f"fewer than {LEAST} samples above {MIN_SPEED} m/s"
    index = np.clip(np.searchsorted(command.t, t[use], side="right") - 1, 0, None)
    held = command.value[index]
    changes = int((np.diff(held) != 0.0).sum())
    if changes < MIN_CHANGES or float(np.std(held)) < MIN_SPREAD:
        return "the steering hardly changes while the car drives: it tells no delay"
    return ""


def yaw_lag(base: Vehicle, speed: FloatArray) -> FloatArray:
    """Mean delay (n,) [s] of the yaw rate behind the wheels: the linear bicycle's, slow inputs."""
    b, p = base.body, base.tyres
    if isinstance(p, AxleTyres):
        front = p.front_D * p.front_C * p.front_B * b.front_load
        rear = p.rear_D * p.rear_C * p.rear_B * b.rear_load
    else:
        front, rear = p.front_D * p.front_C * p.front_B, p.rear_cornering_stiffness
    stiff = b.wheelbase**2 * front * rear + b.mass * speed**2 * (b.l_r * rear - b.l_f * front)
    damping = b.mass * (b.l_f**2 * front + b.l_r**2 * rear) + b.yaw_inertia * (front + rear)
    lead = b.mass * speed * b.l_f / (b.wheelbase * rear)
    least = 0.2 * b.wheelbase**2 * front * rear
    return np.asarray(np.clip(damping * speed / np.maximum(stiff, least) - lead, 0.0, MAX_YAW_LAG))
