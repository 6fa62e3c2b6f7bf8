"""Input of a BNO055 on the car: motion at its position, with bias, scale, mounting and noise.

The register model, or MockNano, samples, filters and quantises these values.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.vehicle import GRAVITY

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ImuParams:
    """Position x, y [m] from the rear axle, mounting sensor to body [rad], and errors.

    ``gyro_bias`` [rad/s] and ``gyro_scale`` act on all three sensor axes
    (bias per axis); noise densities in rad/s/sqrt(Hz) and m/s2/sqrt(Hz).
    ``tilt``: yaw, pitch, roll [rad] of the plate below the mounting. The chip assumes
    that its plate is level, so gravity leaks into its acceleration.
    """

    x: float = 0.0945
    y: float = 0.0
    mount_yaw: float = 0.0
    mount_pitch: float = 0.0
    mount_roll: float = 0.0
    gyro_bias: Vector = (0.0, 0.0, 0.0)
    gyro_scale: float = 1.0
    gyro_noise: float = 0.0
    accel_noise: float = 0.0
    tilt: Vector = (0.0, 0.0, 0.0)


def rotation(yaw: float, pitch: float, roll: float) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the rotation sensor to body, R = R_z(yaw) R_y(pitch) R_x(roll)."""
    cy = math.cos(yaw)
    sy = math.sin(yaw)
    cp = math.cos(pitch)
    sp = math.sin(pitch)
    cr = math.cos(roll)
    sr = math.sin(roll)
    return ((cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr))


def _multiply(row: Vector, rows: tuple[Vector, Vector, Vector]) -> Vector:
    """Multiply a row vector by a matrix."""
    x, y, z = (sum(a * b[k] for a, b in zip(row, rows, strict=True)) for k in range(3))
    return x, y, z


class Imu:
    """Computes the sensor's inputs, in its axes, from the motion of the body.

    ``l_r`` [m]: from the rear axle to the centre of mass. ``dt`` [s]: the tick. White noise of
    density d has samples of standard deviation d sqrt(1 / (2 dt)). It is drawn in blocks of fixed
    length, so that a run depends on the seed alone.
    """

    _BLOCK = 4096

    def __init__(self, params: ImuParams, l_r: float, dt: float,
                 rng: np.random.Generator) -> None:
        self.params = params
        self._ahead = params.x - l_r
        self._left = params.y
        rows = rotation(params.mount_yaw, params.mount_pitch, params.mount_roll)
        self._leak = (0.0, 0.0, 0.0)
        self._tilted = any(params.tilt)
        if self._tilted:
            plate = rotation(*params.tilt)
            # Gravity in the axes of the tilted plate, minus what a level chip removes.
            self._leak = _multiply((GRAVITY * plate[2][0], GRAVITY * plate[2][1],
                                 GRAVITY * (plate[2][2] - 1.0)), rows)
            rows = (_multiply(plate[0], rows), _multiply(plate[1], rows), _multiply(plate[2], rows))
        (self._xx, self._xy, self._xz), (self._yx, self._yy, self._yz), (
            self._zx, self._zy, self._zz) = rows
        per_sample = math.sqrt(0.5 / dt)
        self._gyro_sigma = params.gyro_noise * per_sample
        self._accel_sigma = params.accel_noise * per_sample
        self._rng = rng
        self._noise: list[list[float]] = []
        self._noiseless = not (self._gyro_sigma or self._accel_sigma)

    def sense(self, ax: float, ay: float, omega: float, omega_dot: float,
              rate: float | None = None) -> tuple[Sequence[float], Sequence[float]]:
        """Return (gyro [rad/s], acceleration [m/s2]) in sensor axes, gravity removed.

        ax, ay [m/s2]: acceleration of the centre of mass in body axes; rate:
        yaw rate at the gyro with its effects [rad/s], None = omega.
        """
        p = self.params
        x = self._ahead
        y = self._left
        # From the centre of mass to the sensor: a + omega_dot x r + omega x (omega x r).
        ax += -omega_dot * y - omega * omega * x
        ay += omega_dot * x - omega * omega * y
        # The sensor's axes are the columns of the rotation matrix: transposed products.
        rate = p.gyro_scale * (omega if rate is None else rate)
        bx, by, bz = p.gyro_bias
        gyro = (self._zx * rate + bx, self._zy * rate + by, self._zz * rate + bz)
        accel = (self._xx * ax + self._yx * ay, self._xy * ax + self._yy * ay,
                 self._xz * ax + self._yz * ay)
        if self._tilted:
            gx, gy, gz = self._leak
            accel = (accel[0] + gx, accel[1] + gy, accel[2] + gz)
        if self._noiseless:
            return gyro, accel
        n = self._draw()
        return ((gyro[0] + n[0], gyro[1] + n[1], gyro[2] + n[2]),
                (accel[0] + n[3], accel[1] + n[4], accel[2] + n[5]))

    def _draw(self) -> list[float]:
        if not self._noise:
            sigma = [self._gyro_sigma] * 3 + [self._accel_sigma] * 3
            block = self._rng.normal(0.0, 1.0, (self._BLOCK, 6)) * sigma
            self._noise = block[::-1].tolist()
        return self._noise.pop()
