"""What sensors should read, by the measured motion or at rest, minus what they did read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.predict import sensors
from dart_hal.predict.commands import catmull_rom
from dart_hal.predict.rollout import states
from dart_hal.recording.dart import Grid, savgol_derivative
from dart_hal.types import SAMPLE, FloatArray
from dart_hal.vehicle.channels import late_last, through
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.parameters import Vehicle

from .drive import POINTS, Drive

SENSORS = ("encoder", "gyro", "accel_x", "accel_y")
AROUND = 10  # samples to each side over which a standing car is seen to turn
WINDOW = 10  # samples over which the encoder counts
SMOOTH = 11
"""Samples of the yaw rate against which the gyro is held: with the noise of fewer, whatever
shifts a signal by part of a sample would gain by smoothing it."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The measured motion with its accelerations, and a yaw rate omega (n,) [rad/s] that is
    smoother than that of the grid."""

    now: Now
    omega: FloatArray


def measured(g: Grid) -> Measured:
    """From motion capture alone."""
    rates = [savgol_derivative(v, 2 * POINTS + 1) for v in (g.v_x, g.v_y, g.omega)]
    return Measured(sensors.motion(g.t, states(g), rates), savgol_derivative(g.yaw, SMOOTH))


def driven(p: Vehicle, m: Measured, throttle: FloatArray | None, drive: Drive, late: float,
           apart: float) -> FloatArray:
    """What each sensor of the moving car should read, minus what it read; (k, 4).

    throttle (n,): behind its actuator; None where no effect on a sensor asks for it. late: age of
    the readings [s]; apart: by how much more that of the gyro.
    """
    when, read = drive.at[~drive.still], drive.read[~drive.still]
    if not len(when):
        return np.empty((0, len(SENSORS)))
    now = m.now if throttle is None else sensors.driven(p, m.now, throttle)

    def behind(channel: str, signal: Any) -> tuple[Any, FloatArray]:
        """(the signal behind its effects, where the messages read it in samples)."""
        q, more = late_last(p, channel)
        return through(q, channel, signal, now, SAMPLE), when - (late + more) / SAMPLE

    wheel, at = behind("wheel", np.array(now.v_x))
    way = np.concatenate([[0.0], np.cumsum(0.5 * (wheel[1:] + wheel[:-1]))])
    end, begin = catmull_rom(way, np.stack([at, at - WINDOW]))
    gyro, at = behind("gyro", m.omega)
    accel, at_accel = behind("accel", (now.a_x, now.a_y))
    said = catmull_rom(np.stack([gyro, *accel]),
                       np.stack([at - apart / SAMPLE, at_accel, at_accel]))
    return np.stack([(end - begin) / WINDOW, *said], axis=1) - read


def resting(drive: Drive) -> tuple[Now, FloatArray]:
    """The motion of a standing car at its messages, and how slowly it turns (k,) [rad/s]."""
    at = drive.at[drive.still]
    zero, g = np.zeros(len(at)), drive.grid
    sample = np.arange(len(g))
    now = sensors.motion(np.interp(at, sample, g.t),
                         (zero, zero, np.interp(at, sample, g.yaw), zero, zero, zero))
    end, begin = catmull_rom(g.yaw, np.stack([at + AROUND, at - AROUND]))
    return now, (end - begin) / (2 * AROUND * SAMPLE)


def at_rest(drive: Drive, p: Vehicle, seen: bool = False,
            rest: tuple[Now, FloatArray] | None = None) -> FloatArray:
    """What gyro and accelerometer say of a standing car, minus what they said; (k, 4).

    seen: by motion capture, which knows how slowly it turns all the same. rest: what
    ``resting`` says. The accelerometer in units of its noise while driving; nothing of the encoder.
    """
    now, turning = rest or resting(drive)
    zero = np.zeros(len(turning))
    # read late, a standing car reads the same: and messages are no series of samples
    gyro = through(late_last(p, "gyro")[0], "gyro", turning if seen else zero, now, SAMPLE)
    a_x, a_y = through(late_last(p, "accel")[0], "accel", (zero, zero), now, SAMPLE)
    out = np.stack([zero, gyro, a_x, a_y], axis=1) - drive.read[drive.still]
    out[:, 0] = np.nan
    out[:, 2:] *= drive.noise_scale
    return np.asarray(out)
