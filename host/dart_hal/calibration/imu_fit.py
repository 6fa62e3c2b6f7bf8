"""Fit bias, scale and mounting of an IMU to standstill, full turns and straight accelerations.

On a level floor the car turns about the vertical only. The integral of the gyro over a turn by
theta is, in sensor axes,

    integral = a theta + b T        a = scale (-sin p, cos p sin r, cos p cos r)

with the bias b, pitch p and roll r of ``estimation.frames.Mounting``. The length of a is the scale,
its direction the tilt. The mounting yaw remains: levelled acceleration (t_x, t_y) and acceleration
of the wheels (a_x, a_y) satisfy

    t_x = k_1 + A a_x + B a_y,  t_y = k_2 - B a_x + A a_y,  yaw = atan2(B, A).

Noise of the wheels' acceleration reduces A and B by the same factor, so the yaw is unbiased.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports.workshop import SIGHT_STD
from dart_hal.core.types import INTERVAL_90, Estimate, FloatArray
from dart_hal.estimation.frames import Mounting
from dart_hal.estimation.gyro import GYRO_QUANTUM
from dart_hal.vehicle.fitting.batches import standard_error

from .measured import FitGraph
from .sensor_log import ImuSamples

# Batches of the standstill.
REST_BATCHES = 10
# rad/s/sqrt(Hz): 0.014 deg/s/sqrt(Hz), BNO055 data sheet.
GYRO_NOISE_DENSITY = 2.5e-4
# Standard errors by which a turn may differ from the common scale.
MAX_TURN_DIFFERENCE = 4.0
# The data sheet's 3 % at most, and a margin; a miscounted turn of five is 20 %.
MAX_SCALE_ERROR = 0.05
# s over which accelerations are averaged: some forty edges at 0.8 m/s.
ACCELERATION_WINDOW = 0.25


@dataclass(frozen=True, slots=True)
class GyroRest:
    """Gyro at rest in sensor axes: bias, std (3,) [rad/s]."""

    bias: FloatArray
    std: FloatArray


@dataclass(frozen=True, slots=True)
class MeasuredTurn:
    """samples: from rest to rest; angle [rad]: entered by the operator, left positive."""

    samples: ImuSamples
    angle: float


@dataclass(frozen=True, slots=True)
class GyroMounting:
    """scale, pitch, roll with one sigma. axis (3,): the vertical in sensor axes times scale.

    max_difference: largest difference of a turn from the common scale, relative.
    """

    scale: Estimate
    pitch: Estimate
    roll: Estimate
    axis: FloatArray
    max_difference: float


def measure_rest(samples: ImuSamples) -> GyroRest:
    """Mean and standard error by batches, which include slow noise; at least the rounding error."""
    means = np.array([part.mean(axis=0) for part in np.array_split(samples.gyro, REST_BATCHES)])
    floor = GYRO_QUANTUM / math.sqrt(12.0 * len(samples.t))
    return GyroRest(means.mean(axis=0), np.maximum(standard_error(means), floor))


def fit_axis(turns: Sequence[MeasuredTurn], still: GyroRest) -> GyroMounting:
    """Fit scale and tilt by least squares over the turns, weighted by their angles.

    Raises CalibrationFailed if the turns contradict each other or the gyro.
    """
    angle = np.array([turn.angle for turn in turns])
    time = np.array([turn.samples.duration for turn in turns])
    rotation = np.array([turn.samples.rotation for turn in turns]) - np.outer(time, still.bias)
    weight = angle / float(angle @ angle)
    axis = weight @ rotation
    scale = float(np.linalg.norm(axis))
    # Errors: bias at rest, noise of the gyro, reading of the angles by eye.
    drift = abs(float(weight @ time)) * still.std
    noise = GYRO_NOISE_DENSITY * math.sqrt(float(weight**2 @ time))
    std = np.hypot(drift, noise)
    sight = SIGHT_STD * float(np.linalg.norm(weight)) * scale
    each = np.linalg.norm(rotation, axis=1) / np.abs(angle)
    max_difference = float(np.max(np.abs(each / scale - 1.0)))
    own = np.hypot(SIGHT_STD, time * float(np.max(still.std))) / np.abs(angle)
    if (max_difference > MAX_TURN_DIFFERENCE * float(np.max(own))
            or abs(scale - 1.0) > MAX_SCALE_ERROR):
        raise CalibrationFailed(
            "gyro and measured turns do not agree",
            found=", ".join(f"gyro {math.degrees(float(np.linalg.norm(s))):.0f} deg, measured "
                            f"{math.degrees(a):+.0f} deg" for s, a in zip(rotation, angle,
                                                                         strict=True)),
            expected=f"within {MAX_SCALE_ERROR:.0%}, and all by the same factor",
            likely="a full turn too many or too few, or degrees read in the wrong direction",
            remedy="count full turns from the chalk line and run it again")
    x, y, z = (axis / scale).tolist()
    level = math.hypot(y, z)
    return GyroMounting(Estimate(scale, math.hypot(sight, float(np.max(std)))),
                        Estimate(-math.asin(x), float(std[0]) / scale, "rad"),
                        Estimate(math.atan2(y, z), float(std[1]) / (scale * level), "rad"),
                        axis, max_difference)


def yaw_bias(still: GyroRest, axis: FloatArray) -> Estimate:
    """Bias of the yaw rate [rad/s] after mounting and scale, as the estimation subtracts it."""
    row = axis / float(axis @ axis)
    return Estimate(float(row @ still.bias), float(math.sqrt((row**2) @ (still.std**2))), "rad/s")


def fit_mount_yaw(pulls: Sequence[ImuSamples], mounting: GyroMounting, bias: float,
                  imu_x: float) -> Estimate:
    """Fit the mounting yaw [rad] to straight accelerations.

    bias [rad/s]: of the yaw rate. imu_x [m]: place of the IMU in front of the rear axle.
    Raises CalibrationFailed if the accelerometer does not follow the wheels.
    """
    t_x, t_y, a_x, a_y = _average_pulls(pulls, mounting, bias, imu_x)
    design = np.column_stack([np.ones_like(a_x), a_x, a_y])
    forward, *_ = np.linalg.lstsq(design, t_x, rcond=None)
    sideways, *_ = np.linalg.lstsq(design, t_y, rcond=None)
    residual = t_y - design @ sideways
    freedom = max(len(residual) - 3, 1)
    covariance = np.linalg.inv(design.T @ design) * float(residual @ residual) / freedom
    size = math.hypot(forward[1], sideways[1])
    if size < 0.5 or not np.isfinite(covariance).all():
        raise CalibrationFailed(
            "the accelerometer does not follow the wheels",
            found=f"{size:.2f} of the acceleration of the wheels", expected="about 1, at least 0.5",
            likely="wheels that spin, or an IMU that is loose",
            remedy="dry level floor, IMU screwed tight; run it again")
    return Estimate(math.atan2(-sideways[1], forward[1]), math.sqrt(covariance[1, 1]) / size, "rad")


def graph_pulls(pulls: Sequence[ImuSamples], mounting: GyroMounting, bias: float, imu_x: float,
                yaw: Estimate) -> FitGraph:
    """Return the acceleration to the side by the IMU over that of the wheels ahead.

    Arguments as for ``fit_mount_yaw``; yaw: its result. An IMU that is turned by it shows
    -sin(yaw) of the acceleration ahead as one to the left.
    """
    _, t_y, a_x, a_y = _average_pulls(pulls, mounting, bias, imu_x)
    side = t_y - math.cos(yaw.value) * a_y
    ends = np.array([min(float(a_x.min()), 0.0), max(float(a_x.max()), 0.0)])
    offset = float(np.mean(side + math.sin(yaw.value) * a_x))
    half = INTERVAL_90 * yaw.std * math.cos(yaw.value) * np.abs(ends)
    return FitGraph("Straight acceleration: an IMU that is turned shows a part of it to the side",
                    "acceleration of the wheels [m/s2]", "to the left by the IMU [m/s2]",
                    a_x, side - offset, ends, -math.sin(yaw.value) * ends, half,
                    curve_name="mounting yaw, 90 % interval")


def _average_pulls(pulls: Sequence[ImuSamples], mounting: GyroMounting, bias: float, imu_x: float
                   ) -> FloatArray:
    """Return the windows of all pulls as ``_average_windows``."""
    level = np.array(Mounting(mounting.roll.value, mounting.pitch.value).matrix()).reshape(3, 3)
    row = mounting.axis / float(mounting.axis @ mounting.axis)
    return np.concatenate([_average_windows(pull, level, pull.gyro @ row - bias, imu_x)
                           for pull in pulls], axis=1)


def _average_windows(samples: ImuSamples, level: FloatArray, rate: FloatArray, imu_x: float
                     ) -> FloatArray:
    """Means (t_x, t_y, a_x, a_y) of windows, shape (4, n) [m/s2].

    The acceleration of the wheels is that of the IMU: v' - x w^2 forward, v w + x w' to the left.
    """
    acc = samples.acc @ level.T
    edges = np.arange(samples.t[0], samples.t[-1], ACCELERATION_WINDOW)
    starts = np.unique(np.searchsorted(samples.t, edges))
    rows = []
    for i, j in pairwise(starts.tolist()):
        dt = float(samples.t[j] - samples.t[i])
        v = samples.speed[i:j]
        w = rate[i:j]
        rows.append((acc[i:j, 0].mean(), acc[i:j, 1].mean(),
                     (samples.speed[j] - samples.speed[i]) / dt - imu_x * float((w * w).mean()),
                     float((v * w).mean()) + imu_x * (rate[j] - rate[i]) / dt))
    return np.asarray(np.array(rows).reshape(-1, 4).T)
