"""The recordings of the real car as the Nano of this project would have sent them.

Speeds of 0.1 s become edges with their times, yaw rates samples of 100 Hz, the
commands what the pins carried. Acceleration along the car comes from the
motion capture where there is some; else from the encoder, which then cannot
contradict itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dart_hal.car.telemetry import Telemetry
from dart_hal.core.config import CarFiles
from dart_hal.core.types import Applied, FloatArray, State
from dart_hal.recording.dart import Grid, Recording, grid
from dart_hal.vehicle import PAPER, make_steering
from dart_hal.wire.messages import STATE_FLAGS, TICKS_PER_SECOND

FRAME = 0.01
L_R = 0.0945
"""m: the IMU sits at the centre of mass, ahead of the rear axle where the wheels roll."""
AGE = 0.0065
"""s from an IMU sample to its frame."""
LATE = 0.05
"""s: a speed is the mean of the 0.1 s before its message, a command on average 0.05 s old.
With motion capture the way of the message to the recorder comes on top: ``estimate_delay``."""
# m/s2: change of speed from which on the delay can be estimated.
MIN_ACCEL = 0.5
# s: delay where it cannot.
DEFAULT_DELAY = 0.1
VALID = 1 << STATE_FLAGS.index("IMU_VALID")


@dataclass(frozen=True, slots=True)
class Drive:
    """One gap-free stretch on a grid of 0.01 s; SI units, (n,) each; car frame."""

    name: str
    speed: FloatArray
    yaw_rate: FloatArray
    accel_x: FloatArray
    accel_y: FloatArray
    throttle: FloatArray
    steering: FloatArray
    true_speed: FloatArray

    def __len__(self) -> int:
        return len(self.speed)


class Values(tuple[int, ...]):
    """Values of a frame, as Telemetry reads them."""

    def values(self) -> tuple[int, ...]:
        return self


def drives_of(recording: Recording) -> Iterator[Drive]:
    """Every segment of at least 2 s of a recording with an encoder and an IMU."""
    m = recording.messages
    if recording.schema == "C":
        return
    motion = grid(recording) if recording.mocap is not None else None
    angle = make_steering(PAPER.steering)
    for segment in np.unique(m.segment):
        rows = m.segment == segment
        t = m.arrival[rows]
        if len(t) < 20 or t[-1] - t[0] < 2.0:
            continue
        at = np.arange(t[0], t[-1], FRAME)
        late = LATE if motion is None else estimate_delay(t, np.nan_to_num(m.speed[rows]), motion)
        speed = np.interp(at, t - late, np.nan_to_num(m.speed[rows]))
        held = np.clip(np.searchsorted(t - LATE, at, side="right") - 1, 0, len(t) - 1)
        yaw_rate = np.interp(at, t, np.nan_to_num(m.yaw_rate[rows]))
        accel_x, true = np.gradient(speed, FRAME) - yaw_rate**2 * L_R, speed
        accel_y = speed * yaw_rate
        if motion is not None:
            good = ~motion.bad & np.isfinite(motion.v_x)
            here = np.interp(at, motion.t, good.astype(float)) > 0.99
            a = np.gradient(motion.v_x, FRAME) - motion.omega * motion.v_y
            accel_x = np.where(here, np.interp(at, motion.t, a), np.nan)
            yaw_rate = np.where(here, np.interp(at, motion.t, motion.omega), yaw_rate)
            true = np.where(here, np.interp(at, motion.t, motion.v_x), np.nan)
        yield Drive(recording.name, speed, yaw_rate, accel_x, accel_y, m.throttle[rows][held],
                    np.array([angle(s) for s in m.steering[rows][held]]), true)


def estimate_delay(t: FloatArray, speed: FloatArray, motion: Grid) -> float:
    """s by which the encoder's messages are behind the motion capture, by least squares."""
    good = ~motion.bad & np.isfinite(motion.v_x)
    good &= np.abs(np.gradient(motion.v_x, FRAME)) > MIN_ACCEL
    if not speed.any() or good.sum() < 30:
        return DEFAULT_DELAY

    def miss(late: float) -> float:
        error = np.interp(motion.t[good], t - late, speed) - np.abs(motion.v_x[good])
        return float(np.mean(np.minimum(error**2, 0.25)))

    return min(np.arange(0.0, 0.3, 0.01), key=miss)


def states_of(drive: Drive, files: CarFiles) -> Iterator[State]:
    """The States that ``Telemetry`` makes of it, after 2 s at rest and disarmed."""
    telemetry = Telemetry(files, 20e-6)
    metres = files.metres_per_edge.value
    travel = np.cumsum(np.maximum(drive.speed, 0.0)) * FRAME
    count, last, interval = 0, 0.0, 0.0
    lead = round(2.0 / FRAME)
    before = 0.0
    for k in range(-lead, len(drive)):
        now = (k + lead + 1) * FRAME
        if k >= 0:
            after = travel[k]
            while (count + 1) * metres <= after:
                count += 1
                t = now - FRAME * (1.0 - (count * metres - before) / max(after - before, 1e-12))
                interval, last = t - last, t
            before = after
        has_accel = k >= 0 and bool(np.isfinite(drive.accel_x[k]))
        noise = (k * 7 % 5 - 2, k * 3 % 5 - 2, 1)
        accel = (drive.accel_x[k], drive.accel_y[k]) if has_accel else (0.0, 0.0)
        flags = VALID if k < 0 or has_accel else 0
        rate = drive.yaw_rate[k] if k >= 0 else 0.0
        ticks = round(now * TICKS_PER_SECOND)
        values = Values((
            ticks & 0xFFFFFFFF, count, round(last * TICKS_PER_SECOND),
            min(round(interval * TICKS_PER_SECOND), 65535), 0, 0,
            round(accel[0] * 100) + noise[0], round(accel[1] * 100) + noise[1], 0,
            noise[1], noise[2], round(rate * 900) + noise[0], round(AGE * 250e3), 0xF0, flags, 10))
        throttle, steering = (drive.throttle[k], drive.steering[k]) if k >= 0 else (0.0, 0.0)
        applied = Applied(float(steering), float(throttle), 1500.0, 1500.0,
                          () if k >= 0 else ("NOT_ARMED",))
        yield telemetry.read(values, k, now + 1e-3, 0, applied, 0, None)  # type: ignore[arg-type]
