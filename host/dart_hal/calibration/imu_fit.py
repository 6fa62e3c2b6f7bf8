"""Bias, scale and mounting of an IMU from standstill, full turns and straight pulls.

On a level floor the car turns about the vertical alone, so the integral of the
gyro over a turn by theta is, in sensor axes,

    integral = a theta + b T        a = scale (-sin p, cos p sin r, cos p cos r)

with the bias b, pitch p and roll r of ``estimation.frames.Mounting``: length and
direction of a are scale and tilt. What is left is the turn about the vertical:
levelled acceleration (t_x, t_y) against that of the wheels (a_x, a_y),

    t_x = k_1 + A a_x + B a_y,  t_y = k_2 - B a_x + A a_y,  yaw = atan2(B, A).

Noise of the wheels' acceleration shortens A and B alike and leaves the yaw.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports.workshop import SIGHT_STD
from dart_hal.core.types import Estimate, FloatArray
from dart_hal.estimation.frames import Mounting
from dart_hal.estimation.gyro import GYRO_QUANTUM
from dart_hal.vehicle.fitting.batches import standard_error

from .sensor_log import Sensed

STILL_PARTS = 10
NOISE = 2.5e-4
"""rad/s/sqrt(Hz): 0.014 deg/s/sqrt(Hz), BNO055 data sheet."""
DISAGREE = 4.0
WORST_SCALE = 0.05
"""The data sheet's 3 % at most, and a margin; a miscounted turn of five is 20 %."""
WINDOW = 0.25
"""s over which accelerations are averaged: some forty edges at walking pace."""


@dataclass(frozen=True, slots=True)
class Still:
    """Gyro at rest in sensor axes: bias, std (3,) [rad/s]."""

    bias: FloatArray
    std: FloatArray


@dataclass(frozen=True, slots=True)
class Turn:
    """sensed: from rest to rest; angle [rad] that somebody measured, left positive."""

    sensed: Sensed
    angle: float


@dataclass(frozen=True, slots=True)
class Tilted:
    """scale, pitch, roll with one sigma; axis (3,): the vertical in sensor axes times scale;
    differs: most by which a turn differs from the common scale, relative."""

    scale: Estimate
    pitch: Estimate
    roll: Estimate
    axis: FloatArray
    differs: float


def still_of(sensed: Sensed) -> Still:
    """Mean and its error from batches, so that slow noise counts; never below a rounding step."""
    means = np.array([part.mean(axis=0) for part in np.array_split(sensed.gyro, STILL_PARTS)])
    floor = GYRO_QUANTUM / math.sqrt(12.0 * len(sensed.t))
    return Still(means.mean(axis=0), np.maximum(standard_error(means), floor))


def axis_of(turns: Sequence[Turn], still: Still) -> Tilted:
    """Scale and tilt. Errors: CalibrationFailed when the turns contradict each other."""
    angle = np.array([turn.angle for turn in turns])
    time = np.array([turn.sensed.duration for turn in turns])
    seen = np.array([turn.sensed.turned for turn in turns]) - np.outer(time, still.bias)
    weight = angle / float(angle @ angle)
    axis = weight @ seen
    scale = float(np.linalg.norm(axis))
    drift = abs(float(weight @ time)) * still.std
    noise = NOISE * math.sqrt(float(weight**2 @ time))
    std = np.hypot(drift, noise)
    sight = SIGHT_STD * float(np.linalg.norm(weight)) * scale
    each = np.linalg.norm(seen, axis=1) / np.abs(angle)
    differs = float(np.max(np.abs(each / scale - 1.0)))
    own = np.hypot(SIGHT_STD, time * float(np.max(still.std))) / np.abs(angle)
    if differs > DISAGREE * float(np.max(own)) or abs(scale - 1.0) > WORST_SCALE:
        raise CalibrationFailed(
            "gyro and measured turns do not agree",
            found=", ".join(f"gyro {math.degrees(float(np.linalg.norm(s))):.0f} deg, measured "
                            f"{math.degrees(a):+.0f} deg" for s, a in zip(seen, angle,
                                                                         strict=True)),
            expected=f"within {WORST_SCALE:.0%}, and all by the same factor",
            likely="a full turn too many or too few, or degrees read off the wrong side",
            remedy="count full turns from the chalk line and run it again")
    x, y, z = (axis / scale).tolist()
    level = math.hypot(y, z)
    return Tilted(Estimate(scale, math.hypot(sight, float(np.max(std)))),
                  Estimate(-math.asin(x), float(std[0]) / scale, "rad"),
                  Estimate(math.atan2(y, z), float(std[1]) / (scale * level), "rad"),
                  axis, differs)


def bias_of(still: Still, axis: FloatArray) -> Estimate:
    """Bias of the yaw rate [rad/s] after mounting and scale, as the estimation applies it."""
    row = axis / float(axis @ axis)
    return Estimate(float(row @ still.bias), float(math.sqrt((row**2) @ (still.std**2))), "rad/s")


def yaw_of(pulls: Sequence[Sensed], tilted: Tilted, bias: float, ahead: float) -> Estimate:
    """Mounting yaw [rad]; ``ahead`` [m]: the IMU before the rear axle. Errors: CalibrationFailed.

    bias [rad/s]: of the yaw rate.
    """
    level = np.array(Mounting(tilted.roll.value, tilted.pitch.value).matrix()).reshape(3, 3)
    row = tilted.axis / float(tilted.axis @ tilted.axis)
    parts = [_windows(pull, level, pull.gyro @ row - bias, ahead) for pull in pulls]
    t_x, t_y, a_x, a_y = np.concatenate(parts, axis=1)
    design = np.column_stack([np.ones_like(a_x), a_x, a_y])
    along, *_ = np.linalg.lstsq(design, t_x, rcond=None)
    across, *_ = np.linalg.lstsq(design, t_y, rcond=None)
    left = t_y - design @ across
    freedom = max(len(left) - 3, 1)
    covariance = np.linalg.inv(design.T @ design) * float(left @ left) / freedom
    size = math.hypot(along[1], across[1])
    if size < 0.5 or not np.isfinite(covariance).all():
        raise CalibrationFailed(
            "the accelerometer does not follow the wheels", found=f"{size:.2f} of it",
            expected="about 1", likely="wheels that spin, or an IMU that is loose",
            remedy="dry level floor, IMU screwed tight; run it again")
    return Estimate(math.atan2(-across[1], along[1]), math.sqrt(covariance[1, 1]) / size, "rad")


def _windows(sensed: Sensed, level: FloatArray, rate: FloatArray, ahead: float) -> FloatArray:
    """(t_x, t_y, a_x, a_y) means of windows, shape (4, n) [m/s2]."""
    acc = sensed.acc @ level.T
    edges = np.arange(sensed.t[0], sensed.t[-1], WINDOW)
    starts = np.unique(np.searchsorted(sensed.t, edges))
    rows = []
    for i, j in pairwise(starts.tolist()):
        dt = float(sensed.t[j] - sensed.t[i])
        v, w = sensed.speed[i:j], rate[i:j]
        rows.append((acc[i:j, 0].mean(), acc[i:j, 1].mean(),
                     (sensed.speed[j] - sensed.speed[i]) / dt - ahead * float((w * w).mean()),
                     float((v * w).mean()) + ahead * (rate[j] - rate[i]) / dt))
    return np.asarray(np.array(rows).reshape(-1, 4).T)
