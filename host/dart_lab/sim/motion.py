"""The moving body: one integration step per tick, dynamic or kinematic bicycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from dart_hal.vehicle import (
    SCALAR,
    Vehicle,
    make_dynamic,
    make_dynamic_step,
    make_kinematic,
    make_kinematic_step,
    make_motor_gains,
)
from dart_hal.vehicle.integrate import MAX_RELAXATION


def _dynamic(p: Vehicle, dt: float) -> Callable[..., Any]:
    """A step over one tick: x, y, eta, v_x, v_y, omega; inputs k0, k1, brake, cos d, sin d."""
    step = make_dynamic_step(make_dynamic(p, SCALAR, max_rate=MAX_RELAXATION["rk4"] / dt))
    return lambda *a: step(*a[:6], dt, a[6:], a[6:], a[6:])


def _kinematic(p: Vehicle, dt: float) -> Callable[..., Any]:
    """A step over one tick: x, y, eta, v; inputs k0, k1, brake, tan d."""
    step = make_kinematic_step(make_kinematic(p, SCALAR))
    return lambda *a: step(*a[:4], dt, a[4:], a[4:], a[4:])


class Felt(NamedTuple):
    """Means over one tick: what encoder and IMU feel, body axes, SI units."""

    v_x: float
    a_x: float
    a_y: float
    omega: float
    omega_dot: float


class Motion(Protocol):
    """State of the car; x, y [m] and velocities belong to the centre of mass."""

    x: float
    y: float
    eta: float
    v_x: float
    v_y: float
    omega: float
    drive: Drive

    def step(self, throttle: float, brake: float, angle: float) -> Felt:
        """One tick with throttle -1..1, brake [N] and road-wheel angle [rad] held."""


class Drive:
    """Coefficients of the drive force, kept while nothing about it changes.

    ``leads``: -1 with the motor's leads swapped; ``push`` [N]: a hand at car or wheel.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._gains = make_motor_gains(vehicle.motor)
        self._set = (math.nan, 1.0, 0.0)
        self.leads, self.push = 1.0, 0.0
        self.k0 = self.k1 = 0.0
        self.set(0.0)

    def set(self, throttle: float) -> None:
        now = (throttle, self.leads, self.push)
        if now != self._set:
            self._set = now
            k0, self.k1 = self._gains(throttle)
            self.k0 = self.leads * k0 + self.push


class DynamicMotion:
    """Dynamic bicycle with tyres, valid at rest and in reverse; RK4."""

    def __init__(self, vehicle: Vehicle, dt: float) -> None:
        self.x, self.y, self.eta = vehicle.body.l_r, 0.0, 0.0
        self.v_x = self.v_y = self.omega = 0.0
        self._per_dt = 1.0 / dt
        self._advance = _dynamic(vehicle, dt)
        self.drive = Drive(vehicle)
        self._angle, self._cos, self._sin = 0.0, 1.0, 0.0

    def step(self, throttle: float, brake: float, angle: float) -> Felt:
        drive = self.drive
        drive.set(throttle)
        if angle != self._angle:
            self._angle, self._cos, self._sin = angle, math.cos(angle), math.sin(angle)
        u, v, r, f = self.v_x, self.v_y, self.omega, self._per_dt
        self.x, self.y, self.eta, vx, vy, om = self._advance(
            self.x, self.y, self.eta, u, v, r, drive.k0, drive.k1, brake, self._cos, self._sin)
        self.v_x, self.v_y, self.omega = vx, vy, om
        mean_u, mean_v, mean_r = 0.5 * (u + vx), 0.5 * (v + vy), 0.5 * (r + om)
        return Felt(mean_u, (vx - u) * f - mean_r * mean_v, (vy - v) * f + mean_r * mean_u,
                    mean_r, (om - r) * f)


class KinematicMotion:
    """Kinematic bicycle: no slip, the yaw rate follows the road wheels at once."""

    def __init__(self, vehicle: Vehicle, dt: float) -> None:
        self.x, self.y, self.eta = vehicle.body.l_r, 0.0, 0.0
        self.v_x = self.v_y = self.omega = 0.0
        self._per_dt = 1.0 / dt
        self._l_r, self._wheelbase = vehicle.body.l_r, vehicle.body.wheelbase
        self._advance = _kinematic(vehicle, dt)
        self.drive = Drive(vehicle)

    def step(self, throttle: float, brake: float, angle: float) -> Felt:
        drive, f, tan = self.drive, self._per_dt, math.tan(angle)
        drive.set(throttle)
        u, v, r = self.v_x, self.v_y, self.omega
        self.x, self.y, self.eta, vx = self._advance(
            self.x, self.y, self.eta, u, drive.k0, drive.k1, brake, tan)
        om = vx * tan / self._wheelbase
        vy = self._l_r * om
        self.v_x, self.v_y, self.omega = vx, vy, om
        mean_u, mean_v, mean_r = 0.5 * (u + vx), 0.5 * (v + vy), 0.5 * (r + om)
        return Felt(mean_u, (vx - u) * f - mean_r * mean_v, (vy - v) * f + mean_r * mean_u,
                    mean_r, (om - r) * f)
