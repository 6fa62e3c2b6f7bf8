"""Predicted minus measured sensor readings, from the measured motion or of a car at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Grid, savgol_derivative
from dart_hal.vehicle.channels import split_final_delay, transform_signal
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction import sensors
from dart_lab.identification.prediction.commands import catmull_rom
from dart_lab.identification.prediction.rollout import states

from .drive import DERIVATIVE_POINTS, RecordedDrive

SENSORS = ("encoder", "gyro", "accel_x", "accel_y")
REST_YAW_SAMPLES = 10  # samples to each side over which the yaw rate of a car at rest is taken
ENCODER_SAMPLES = 10  # samples over which the encoder counts
# Samples of the derivative that gives the yaw rate to which the gyro is compared. With fewer the
# yaw rate has more noise, and any effect that shifts a signal by part of a sample would reduce the
# loss by smoothing that noise.
YAW_RATE_POINTS = 11


@dataclass(frozen=True, slots=True)
class MeasuredMotion:
    """Measured motion with accelerations.

    omega (n,): yaw rate [rad/s] from more samples than that of the grid.
    """

    now: Now
    omega: FloatArray


def measured_motion(g: Grid) -> MeasuredMotion:
    """Differentiate the motion of motion capture."""
    rates = [savgol_derivative(v, 2 * DERIVATIVE_POINTS + 1) for v in (g.v_x, g.v_y, g.omega)]
    return MeasuredMotion(sensors.motion(g.t, states(g), rates),
                          savgol_derivative(g.yaw, YAW_RATE_POINTS))


def add_wheel_force(p: Vehicle, m: MeasuredMotion, throttle: FloatArray) -> MeasuredMotion:
    """Add the force at the wheels; throttle (n,): output of its actuator."""
    return replace(m, now=sensors.add_drive_force(p, m.now, throttle))


def predict_readings(p: Vehicle, m: MeasuredMotion, drive: RecordedDrive, signal: str,
                     message_age: float) -> FloatArray:
    """Predict the readings of a signal while driving.

    signal: "wheel" (k, 1), "gyro" (k, 1) or "accel" (k, 2). message_age [s]: of the readings.

    1. Pass the measured motion through the effects on the signal, but for its delay.
    2. Look the result up at the time of each message minus message age and delay.
    3. The encoder counts edges: its reading is the distance over the last 0.1 s per time.
    """
    samples = drive.message_samples[~drive.at_rest]
    now = m.now
    true = {"wheel": np.array(now.v_x), "gyro": m.omega, "accel": (now.a_x, now.a_y)}[signal]
    q, delay = split_final_delay(p, signal)
    readings = transform_signal(q, signal, true, now, SAMPLE)
    samples = samples - (message_age + delay) / SAMPLE
    if signal != "wheel":
        return np.stack([catmull_rom(series, samples)
                         for series in (readings if signal == "accel" else (readings,))], axis=1)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (readings[1:] + readings[:-1]))])
    end, begin = catmull_rom(distance, np.stack([samples, samples - ENCODER_SAMPLES]))
    return np.asarray((end - begin) / ENCODER_SAMPLES)[:, None]


def rest_motion(drive: RecordedDrive) -> tuple[Now, FloatArray]:
    """Return the motion at messages of a car at rest, and its small yaw rate (k,) [rad/s]."""
    samples = drive.message_samples[drive.at_rest]
    zero = np.zeros(len(samples))
    g = drive.grid
    index = np.arange(len(g))
    now = sensors.motion(np.interp(samples, index, g.t),
                         (zero, zero, np.interp(samples, index, g.yaw), zero, zero, zero))
    end, begin = catmull_rom(g.yaw, np.stack([samples + REST_YAW_SAMPLES,
                                              samples - REST_YAW_SAMPLES]))
    return now, (end - begin) / (2 * REST_YAW_SAMPLES * SAMPLE)


def rest_residuals(drive: RecordedDrive, p: Vehicle, has_mocap: bool = False,
                   rest: tuple[Now, FloatArray] | None = None) -> FloatArray:
    """Compute predicted minus measured gyro and accelerometer at rest, (k, 4).

    has_mocap: motion capture measures how slowly the car turns at rest. rest: as ``rest_motion``
    returns it. The accelerometer is multiplied by its noise scale while driving; the encoder is
    NaN.
    """
    now, yaw_rate = rest or rest_motion(drive)
    zero = np.zeros(len(yaw_rate))
    # A delay changes no reading at rest, and messages are no evenly sampled series to delay.
    gyro = transform_signal(split_final_delay(p, "gyro")[0], "gyro",
                            yaw_rate if has_mocap else zero, now, SAMPLE)
    a_x, a_y = transform_signal(split_final_delay(p, "accel")[0], "accel", (zero, zero), now,
                                SAMPLE)
    out = np.stack([zero, gyro, a_x, a_y], axis=1) - drive.readings[drive.at_rest]
    out[:, 0] = np.nan
    out[:, 2:] *= drive.noise_scale
    return np.asarray(out)
