"""What sensors should read, by the measured motion or at rest, minus what they did read."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Grid, savgol_derivative
from dart_hal.vehicle.channels import late_last, through
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction import sensors
from dart_lab.identification.prediction.commands import catmull_rom
from dart_lab.identification.prediction.rollout import states

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


def pulled(p: Vehicle, m: Measured, throttle: FloatArray) -> Measured:
    """The same with the force at the wheels; throttle (n,): behind its actuator."""
    return replace(m, now=sensors.driven(p, m.now, throttle))


def driven(p: Vehicle, m: Measured, drive: Drive, signal: str, late: float) -> FloatArray:
    """What a signal of the moving car should read: "wheel" (k, 1), "gyro" (k, 1), "accel" (k, 2).

    late: age of the readings [s].
    """
    when, now = drive.at[~drive.still], m.now
    true = {"wheel": np.array(now.v_x), "gyro": m.omega, "accel": (now.a_x, now.a_y)}[signal]
    q, more = late_last(p, signal)
    shown, at = through(q, signal, true, now, SAMPLE), when - (late + more) / SAMPLE
    if signal != "wheel":
        return np.stack([catmull_rom(s, at) for s in (shown if signal == "accel" else (shown,))],
                        axis=1)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (shown[1:] + shown[:-1]))])
    end, begin = catmull_rom(way, np.stack([at, at - WINDOW]))
    return np.asarray((end - begin) / WINDOW)[:, None]


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
