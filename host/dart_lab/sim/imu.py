"""What a BNO055 at its place on the car senses: bias, scale, mounting, noise.

The register model (or MockNano) samples, filters and quantises these values.
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
    """Place [m] from the rear axle, mounting sensor to body [rad], errors.

    ``gyro_bias`` [rad/s] and ``gyro_scale`` act on all three sensor axes
    (bias per axis); noise densities in rad/s/sqrt(Hz) and m/s2/sqrt(Hz).
    ``tilt``: yaw, pitch, roll [rad] of the plate that the mounting is on. The
    chip takes its plate for level, so gravity leaks into its acceleration.
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
    """Rows of the matrix sensor -> body: yaw about z, then pitch about y, roll about x."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cr, sr = math.cos(roll), math.sin(roll)
    return ((cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr))


def _times(row: Vector, rows: tuple[Vector, Vector, Vector]) -> Vector:
    """A row vector times a matrix."""
    x, y, z = (sum(a * b[k] for a, b in zip(row, rows, strict=True)) for k in range(3))
    return x, y, z


class Imu:
    """Turns motion of the body into true values in sensor axes.

    ``l_r`` [m]: centre of mass ahead of the rear axle. ``dt`` [s]: the tick,
    which sets the size of the noise samples. Noise comes in blocks, so that
    a run depends on the seed alone.
    """

    _BLOCK = 4096

    def __init__(self, params: ImuParams, l_r: float, dt: float,
                 rng: np.random.Generator) -> None:
        self.params = params
        self._ahead, self._left = params.x - l_r, params.y
        rows = rotation(params.mount_yaw, params.mount_pitch, params.mount_roll)
        self._leak = (0.0, 0.0, 0.0)
        self._tilted = any(params.tilt)
        if self._tilted:
            plate = rotation(*params.tilt)
            self._leak = _times((GRAVITY * plate[2][0], GRAVITY * plate[2][1],
                                 GRAVITY * (plate[2][2] - 1.0)), rows)
            rows = (_times(plate[0], rows), _times(plate[1], rows), _times(plate[2], rows))
        (self._xx, self._xy, self._xz), (self._yx, self._yy, self._yz), (
            self._zx, self._zy, self._zz) = rows
        per_sample = math.sqrt(0.5 / dt)
        self._gyro_sigma = params.gyro_noise * per_sample
        self._accel_sigma = params.accel_noise * per_sample
        self._rng = rng
        self._noise: list[list[float]] = []
        self._quiet = not (self._gyro_sigma or self._accel_sigma)

    def sense(self, ax: float, ay: float, omega: float, omega_dot: float,
              rate: float | None = None) -> tuple[Sequence[float], Sequence[float]]:
        """``(gyro, acceleration)`` in sensor axes, gravity removed.

        ax, ay [m/s2]: acceleration of the centre of mass in body axes; rate:
        what the gyro takes for omega [rad/s], None = omega.
        """
        p = self.params
        x, y = self._ahead, self._left
        ax += -omega_dot * y - omega * omega * x
        ay += omega_dot * x - omega * omega * y
        rate = p.gyro_scale * (omega if rate is None else rate)
        bx, by, bz = p.gyro_bias
        gyro = (self._zx * rate + bx, self._zy * rate + by, self._zz * rate + bz)
        accel = (self._xx * ax + self._yx * ay, self._xy * ax + self._yy * ay,
                 self._xz * ax + self._yz * ay)
        if self._tilted:
            gx, gy, gz = self._leak
            accel = (accel[0] + gx, accel[1] + gy, accel[2] + gz)
        if self._quiet:
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
