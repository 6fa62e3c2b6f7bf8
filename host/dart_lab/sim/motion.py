"""Motion of the car: one integration step per tick of a dynamic or kinematic bicycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

from dart_hal.vehicle import (
    SCALAR,
    Vehicle,
    make_kinematic,
    make_kinematic_step,
    make_motor_gains,
)
from dart_hal.vehicle.native import CannotCompile, make_native_step
from dart_hal.vehicle.step import make_tick_step


def _make_dynamic_tick(p: Vehicle, dt: float) -> Callable[..., Any]:
    """Make the step of ``make_tick_step``, compiled where there is a compiler; the same numbers."""
    # The kernel of a kinematic vehicle would not have its form of the slip angles.
    p = replace(p, kind="dynamic")
    try:
        return make_native_step(p, "tick", dt)
    except CannotCompile:
        return make_tick_step(p, SCALAR, dt)


def _make_kinematic_tick(p: Vehicle, dt: float) -> Callable[..., Any]:
    """Make the step of a tick: x, y, eta, v; inputs k0, k1, brake, tan d."""
    step = make_kinematic_step(make_kinematic(p, SCALAR))
    return lambda *a: step(*a[:4], dt, a[4:], a[4:], a[4:])


class MeanMotion(NamedTuple):
    """Means over one tick, at the encoder and the IMU, in body axes and SI units."""

    v_x: float
    a_x: float
    a_y: float
    omega: float
    omega_dot: float


class MotionModel(Protocol):
    """State of the car; x, y [m] and velocities belong to the centre of mass."""

    x: float
    y: float
    eta: float
    v_x: float
    v_y: float
    omega: float
    drive: MotorForce

    def step(self, throttle: float, brake: float, angle: float) -> MeanMotion:
        """Advance one tick with constant throttle -1..1, brake [N] and road-wheel angle [rad]."""


class MotorForce:
    """Drive force k0 - k1 v [N]; the coefficients are computed only when an input changes.

    ``leads``: -1 with the motor's leads swapped; ``push``: force of a hand at car or wheel [N].
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._gains = make_motor_gains(vehicle.motor)
        self._inputs = (math.nan, 1.0, 0.0)
        self.leads = 1.0
        self.push = 0.0
        self.k0 = self.k1 = 0.0
        self.set_throttle(0.0)

    def set_throttle(self, throttle: float) -> None:
        now = (throttle, self.leads, self.push)
        if now != self._inputs:
            self._inputs = now
            k0, self.k1 = self._gains(throttle)
            self.k0 = self.leads * k0 + self.push


class BicycleMotion:
    """State at rest, with the rear axle at the origin; base class of both bicycles."""

    def __init__(self, vehicle: Vehicle, dt: float) -> None:
        # The centre of mass is l_r ahead of the rear axle, which is at the origin.
        self.x = vehicle.body.l_r
        self.y = 0.0
        self.eta = 0.0
        self.v_x = self.v_y = self.omega = 0.0
        self._per_dt = 1.0 / dt
        self.drive = MotorForce(vehicle)

    def _set_velocities(self, vx: float, vy: float, om: float) -> MeanMotion:
        """Set the velocities at the end of a tick; return the means over it."""
        u = self.v_x
        v = self.v_y
        r = self.omega
        f = self._per_dt
        self.v_x = vx
        self.v_y = vy
        self.omega = om
        # Mean acceleration of the body, in its rotating axes: a = dv/dt + omega x v.
        mean_u = 0.5 * (u + vx)
        mean_v = 0.5 * (v + vy)
        mean_r = 0.5 * (r + om)
        return MeanMotion(mean_u, (vx - u) * f - mean_r * mean_v, (vy - v) * f + mean_r * mean_u,
                          mean_r, (om - r) * f)


class DynamicMotion(BicycleMotion):
    """Dynamic bicycle with tyres, valid at rest and in reverse, integrated by RK4."""

    def __init__(self, vehicle: Vehicle, dt: float) -> None:
        super().__init__(vehicle, dt)
        self._advance = _make_dynamic_tick(vehicle, dt)
        self._angle = 0.0
        self._cos = 1.0
        self._sin = 0.0

    def step(self, throttle: float, brake: float, angle: float) -> MeanMotion:
        drive = self.drive
        drive.set_throttle(throttle)
        if angle != self._angle:
            self._angle = angle
            self._cos = math.cos(angle)
            self._sin = math.sin(angle)
        self.x, self.y, self.eta, vx, vy, om, *_ = self._advance(
            self.x, self.y, self.eta, self.v_x, self.v_y, self.omega, drive.k0, drive.k1, brake,
            self._cos, self._sin)
        # The velocities before the tick are still set, so that their means can be taken.
        return self._set_velocities(vx, vy, om)


class KinematicMotion(BicycleMotion):
    """Kinematic bicycle: no slip, the yaw rate follows the road wheels without delay."""

    def __init__(self, vehicle: Vehicle, dt: float) -> None:
        super().__init__(vehicle, dt)
        self._l_r = vehicle.body.l_r
        self._wheelbase = vehicle.body.wheelbase
        self._advance = _make_kinematic_tick(vehicle, dt)

    def step(self, throttle: float, brake: float, angle: float) -> MeanMotion:
        drive = self.drive
        # The yaw rate needs no integration: it follows speed and road-wheel angle.
        tan = math.tan(angle)
        drive.set_throttle(throttle)
        self.x, self.y, self.eta, vx = self._advance(
            self.x, self.y, self.eta, self.v_x, drive.k0, drive.k1, brake, tan)
        # Without slip: yaw rate = v tan(delta) / wheelbase, v_y of the centre of mass = l_r omega.
        om = vx * tan / self._wheelbase
        return self._set_velocities(vx, self._l_r * om, om)
