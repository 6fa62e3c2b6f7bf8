"""What sensors should read, by the measured motion or at rest, minus what they did read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.recording.dart import Grid, savgol_derivative
from dart_hal.types import FloatArray
from dart_hal.vehicle.channels import late_last, through
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, Vehicle

from .drive import POINTS, STEP, Drive, between

SENSORS = ("encoder", "gyro", "accel_x", "accel_y")
AROUND = 10  # samples to each side over which a standing car is seen to turn
WINDOW = 10  # samples over which the encoder counts
SMOOTH = 11
"""Samples of the yaw rate against which the gyro is held: with the noise of fewer, whatever
shifts a signal by part of a sample would gain by smoothing it."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The measured motion with what sensors feel of it, (n,) each.

    omega: smoother than that of the grid [rad/s]; a_x, a_y [m/s2], alpha
    [rad/s2]; turns of the gear since the start.
    """

    grid: Grid
    omega: FloatArray
    a_x: FloatArray
    a_y: FloatArray
    alpha: FloatArray
    turns: FloatArray


def measured(g: Grid) -> Measured:
    """From motion capture alone."""
    rates = [savgol_derivative(v, 2 * POINTS + 1, STEP) for v in (g.v_x, g.v_y, g.omega)]
    return Measured(g, savgol_derivative(g.yaw, SMOOTH, STEP), rates[0] - g.omega * g.v_y,
                    rates[1] + g.omega * g.v_x, rates[2],
                    np.cumsum(g.v_x) * STEP / GEAR_REVOLUTION)


def driven(p: Vehicle, m: Measured, throttle: FloatArray, drive: Drive, late: float,
           apart: float) -> FloatArray:
    """What each sensor of the moving car should read, minus what it read; (k, 4).

    throttle (n,): behind its actuator. late: age of the readings [s]; apart: by how
    much more that of the gyro.
    """
    when, read = drive.at[~drive.still], drive.read[~drive.still]
    if not len(when):
        return np.empty((0, len(SENSORS)))
    g, q = m.grid, settled(p)
    force = make_motor(q.motor, ARRAY)(throttle, g.v_x) + make_friction(q.friction, ARRAY)(g.v_x)
    now = Now(g.t, g.v_x, g.v_y, g.omega, g.yaw, m.a_x, m.a_y, m.alpha, force, m.turns)

    def behind(channel: str, signal: Any) -> tuple[Any, FloatArray]:
        """(the signal behind its effects, where the messages read it in samples)."""
        q, more = late_last(p, channel)
        return through(q, channel, signal, now, STEP), when - (late + more) / STEP

    wheel, at = behind("wheel", np.array(g.v_x))
    way = np.concatenate([[0.0], np.cumsum(0.5 * (wheel[1:] + wheel[:-1]))])
    encoder = (between(way, at) - between(way, at - WINDOW)) / WINDOW
    gyro, at = behind("gyro", m.omega)
    accel, at_accel = behind("accel", (m.a_x, m.a_y))
    said = [encoder, between(gyro, at - apart / STEP), *(between(v, at_accel) for v in accel)]
    return np.stack(said, axis=1) - read


def at_rest(drive: Drive, p: Vehicle, seen: bool = False) -> FloatArray:
    """What gyro and accelerometer say of a standing car, minus what they said; (k, 4).

    seen: by motion capture, which knows how slowly it turns all the same. The
    accelerometer in units of its noise while driving; nothing of the encoder.
    """
    at = drive.at[drive.still]
    zero, g = np.zeros(len(at)), drive.grid
    sample = np.arange(len(g))
    now = Now(np.interp(at, sample, g.t), zero, zero, zero, np.interp(at, sample, g.yaw))
    turning = (between(g.yaw, at + AROUND) - between(g.yaw, at - AROUND)) / (2 * AROUND * STEP)
    # read late, a standing car reads the same: and messages are no series of samples
    gyro = through(late_last(p, "gyro")[0], "gyro", turning if seen else zero, now, STEP)
    a_x, a_y = through(late_last(p, "accel")[0], "accel", (zero, zero), now, STEP)
    out = np.stack([zero, gyro, a_x, a_y], axis=1) - drive.read[drive.still]
    out[:, 0] = np.nan
    out[:, 2:] *= drive.felt
    return np.asarray(out)
