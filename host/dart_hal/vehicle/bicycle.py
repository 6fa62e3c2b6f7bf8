"""Equations of motion of the bicycle, reference point: centre of mass.

State x, y [m], eta [rad], v_x, v_y [m/s] in body axes, omega [rad/s]. What an
actuator holds over an integration step enters as coefficients: the drive
(k0, k1, brake) of ``make_motor_gains`` and cosine and sine of the road-wheel
angle, so that the inner loop evaluates only what changes with the state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.compose import Hook, force_hooks, settled
from dart_hal.vehicle.effect import Forces
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor_gains
from dart_hal.vehicle.namespace import Namespace, Value, adapt
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.tyres import Force, Slip, make_slip, make_tyres

Rates = tuple[Value, Value, Value, Value, Value, Value]


def make_dynamic(p: Vehicle, xp: Any = math, slip: str | None = None) -> Callable[..., Rates]:
    """``rates(eta, v_x, v_y, omega, k0, k1, brake, cos d, sin d)``: d(state)/dt.

    Returns (x', y', eta', v_x', v_y', omega'). Body-frame accelerations are
    v_x' - omega v_y and v_y' + omega v_x. slip: form of the slip angles, None
    = the vehicle's own.
    """
    f = adapt(xp)
    sin, cos = f.sin, f.cos
    l_f, l_r = p.body.l_f, p.body.l_r
    per_mass, per_inertia = 1.0 / p.body.mass, 1.0 / p.body.yaw_inertia
    share_f, share_r = p.body.front_share, 1.0 - p.body.front_share
    friction = make_friction(p.friction, f)
    angles = make_slip(p.body, f, slip or p.slip)
    front, rear = make_tyres(p.tyres, p.body, f)
    hooks = force_hooks(p, f)
    if hooks:
        return _extended(p, f, hooks, friction, angles, front, rear)

    def rates(eta: Value, vx: Value, vy: Value, om: Value, k0: Value, k1: Value, brake: Value,
              cd: Value, sd: Value) -> Rates:
        alpha_f, alpha_r = angles(vx, vy, om, cd, sd)
        f_w = k0 - k1 * vx + friction(vx, brake)
        f_xf, f_yf, f_yr = share_f * f_w, front(alpha_f), rear(alpha_r)
        f_left = f_yf * cd + f_xf * sd
        ce, se = cos(eta), sin(eta)
        return (vx * ce - vy * se, vx * se + vy * ce, om,
                (share_r * f_w + f_xf * cd - f_yf * sd) * per_mass + om * vy,
                (f_yr + f_left) * per_mass - om * vx,
                (l_f * f_left - l_r * f_yr) * per_inertia)

    return rates


def _extended(p: Vehicle, f: Namespace, hooks: tuple[Hook, ...], friction: Callable[..., Value],
              angles: Slip, front: Force, rear: Force) -> Callable[..., Rates]:
    """The same motion with the forces passed through the effects of the vehicle."""
    sin, cos = f.sin, f.cos
    l_f, l_r = p.body.l_f, p.body.l_r
    per_mass, per_inertia = 1.0 / p.body.mass, 1.0 / p.body.yaw_inertia
    share_f, share_r = p.body.front_share, 1.0 - p.body.front_share

    def rates(eta: Value, vx: Value, vy: Value, om: Value, k0: Value, k1: Value, brake: Value,
              cd: Value, sd: Value) -> Rates:
        alpha_f, alpha_r = angles(vx, vy, om, cd, sd)
        f_w = k0 - k1 * vx + friction(vx, brake)
        q = Forces(eta, vx, vy, om, cd, sd, alpha_f, alpha_r, share_f * f_w, share_r * f_w,
                   front(alpha_f), rear(alpha_r), 0.0, 0.0, 0.0)
        for hook in hooks:
            q = hook(q)
        f_left = q.f_yf * q.cos_d + q.f_xf * q.sin_d
        ce, se = cos(eta), sin(eta)
        return (vx * ce - vy * se, vx * se + vy * ce, om,
                (q.f_xr + q.f_xf * q.cos_d - q.f_yf * q.sin_d + q.f_x) * per_mass + om * vy,
                (q.f_yr + f_left + q.f_y) * per_mass - om * vx,
                (l_f * f_left - l_r * q.f_yr + q.m_z) * per_inertia)

    return rates


def make_kinematic(p: Vehicle, xp: Any = math) -> Callable[..., tuple[Value, Value, Value, Value]]:
    """``rates(eta, v, k0, k1, brake, tan d)``: (x', y', eta', v'), no tyre slip.

    v is the speed of the rear axle, x and y belong to the centre of mass; the
    lateral velocity there is l_r omega with omega = v tan(d) / wheelbase.
    """
    f = adapt(xp)
    sin, cos = f.sin, f.cos
    l_r, per_wheelbase, per_mass = p.body.l_r, 1.0 / p.body.wheelbase, 1.0 / p.body.mass
    friction = make_friction(p.friction, f)

    def rates(eta: Value, v: Value, k0: Value, k1: Value, brake: Value,
              td: Value) -> tuple[Value, Value, Value, Value]:
        om = v * td * per_wheelbase
        vy = l_r * om
        ce, se = cos(eta), sin(eta)
        return (v * ce - vy * se, v * se + vy * ce, om,
                (k0 - k1 * v + friction(v, brake)) * per_mass)

    return rates


def make_acceleration(p: Vehicle, xp: Any = math,
                      slip: str | None = None) -> Callable[..., tuple[Value, Value, Value]]:
    """``acceleration(v_x, v_y, omega, tau, delta) -> (v_x', v_y', omega')``.

    The same equations with the commands as they are named in the paper:
    throttle after the dead band of the ESC, road-wheel angle in rad.
    """
    f, p = adapt(xp), settled(p)
    rates, gains = make_dynamic(p, f, slip), make_motor_gains(p.motor, f)

    def acceleration(vx: Value, vy: Value, om: Value, tau: Value,
                     delta: Value) -> tuple[Value, Value, Value]:
        k0, k1 = gains(tau)
        full = rates(0.0, vx, vy, om, k0, k1, 0.0, f.cos(delta), f.sin(delta))
        return full[3], full[4], full[5]

    return acceleration
