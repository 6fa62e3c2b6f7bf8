"""Dynamic and kinematic bicycle; reference point: centre of mass, axes of ISO 8855.

The state is x = [x, y, eta, v_x, v_y, omega]: position [m] and yaw angle [rad]
in the plane, velocity [m/s] in body axes, yaw rate [rad/s]. The input is
u = [tau, delta]: throttle and road-wheel angle [rad], positive to the left.

The dynamic bicycle is defined by

    x'     = v_x cos(eta) - v_y sin(eta)
    y'     = v_x sin(eta) + v_y cos(eta)
    eta'   = omega
    v_x'   = (F_xr + F_xf cos(delta) - F_yf sin(delta)) / m   + omega v_y
    v_y'   = (F_yr + F_yf cos(delta) + F_xf sin(delta)) / m   - omega v_x
    omega' = (l_f (F_yf cos(delta) + F_xf sin(delta)) - l_r F_yr) / I_z

    F_x  = motor(tau, v_x) + friction(v_x),  F_xf = share F_x,  F_xr = (1 - share) F_x
    F_yf = front(alpha_f),  F_yr = rear(alpha_r)

and about straight driving at a speed v, with C = dF_y / d alpha of an axle, by

    d/dt [v_y, omega] = A [v_y, omega] + B delta

    A = [[-(C_f + C_r) / (m v),              (l_r C_r - l_f C_f) / (m v) - v     ],
         [ (l_r C_r - l_f C_f) / (I_z v),   -(l_f^2 C_f + l_r^2 C_r) / (I_z v)  ]]
    B = [C_f / m,  l_f C_f / I_z]

The kinematic bicycle has no slip: omega = v tan(delta) / (l_f + l_r), v of the
rear axle. Parameters are those of a ``Vehicle``; motor, friction and tyres have
a module each. An effect enters as forces (``effect.Forces``).

Source: L. Lyons, T. Niesten, L. Ferranti, "DART: A Compact Platform for
Autonomous Driving Research" (2024); A and B as in R. Rajamani, "Vehicle
Dynamics and Control" (2012), section 2.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.compose import apply_parameter_effects, force_hooks
from dart_hal.vehicle.effect import Forces
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_drive_gains, make_force_limit
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.tyres import make_slip, make_tyres, min_slip_divisor

Rates = tuple[Value, Value, Value, Value, Value, Value]


def make_dynamic(p: Vehicle, xp: Any = math, slip: str | None = None,
                 max_rate: Value | None = None) -> Callable[..., Rates]:
    """Return ``rates(eta, v_x, v_y, omega, k0, k1, brake, cos d, sin d)``: d(state)/dt.

    The rates are (x', y', eta', v_x', v_y', omega'). Inputs that are constant over an
    integration step enter as coefficients: the drive (k0, k1, brake) of
    ``make_drive_gains``, cosine and sine of the road-wheel angle. Accelerations
    in body axes are v_x' - omega v_y and v_y' + omega v_x. slip: form of the
    slip angles, None = the vehicle's own. max_rate [1/s]: fastest relaxation of
    v_y and omega, for an integrator of a known step (``integrate.MAX_RELAXATION``);
    None: without limit.
    """
    f = adapt(xp)
    sin = f.sin
    cos = f.cos
    l_f = p.body.l_f
    l_r = p.body.l_r
    per_mass = 1.0 / p.body.mass
    per_inertia = 1.0 / p.body.yaw_inertia
    share_f = p.body.front_share
    share_r = 1.0 - p.body.front_share
    friction = make_friction(p.friction, f)
    limit = make_force_limit(p.motor, f)
    least = None if max_rate is None else min_slip_divisor(p.tyres, p.body, f, max_rate)
    angles = make_slip(p.body, f, slip or p.slip, least)
    front, rear = make_tyres(p.tyres, p.body, f)
    hooks = force_hooks(p, f)

    def rates(eta: Value, vx: Value, vy: Value, om: Value, k0: Value, k1: Value, brake: Value,
              cd: Value, sd: Value) -> Rates:
        alpha_f, alpha_r = angles(vx, vy, om, cd, sd)
        f_w = limit(k0 - k1 * vx) + friction(vx, brake)
        # 1. forces of each axle in its own frame
        f_xf = share_f * f_w
        f_xr = share_r * f_w
        f_yf = front(alpha_f)
        f_yr = rear(alpha_r)
        # 2. effects change them; the branch depends on the vehicle only, never on the state
        if hooks:
            q = Forces(eta, vx, vy, om, cd, sd, alpha_f, alpha_r, f_xf, f_xr, f_yf, f_yr,
                       0.0, 0.0, 0.0)
            for hook in hooks:
                q = hook(q)
            cd = q.cos_d
            sd = q.sin_d
            f_xf = q.f_xf
            f_xr = q.f_xr
            f_yf = q.f_yf
            f_yr = q.f_yr
        # 3. sum of forces in body axes and of moments about the centre of mass
        f_left = f_yf * cd + f_xf * sd
        f_x = f_xr + f_xf * cd - f_yf * sd
        f_y = f_yr + f_left
        m_z = l_f * f_left - l_r * f_yr
        if hooks:
            f_x = f_x + q.f_x
            f_y = f_y + q.f_y
            m_z = m_z + q.m_z
        # 4. Newton and Euler in rotating axes; the velocity in the plane
        ce = cos(eta)
        se = sin(eta)
        return (vx * ce - vy * se, vx * se + vy * ce, om, f_x * per_mass + om * vy,
                f_y * per_mass - om * vx, m_z * per_inertia)

    return rates


def make_kinematic(p: Vehicle, xp: Any = math) -> Callable[..., tuple[Value, Value, Value, Value]]:
    """Return ``rates(eta, v, k0, k1, brake, tan d)``: (x', y', eta', v'), no tyre slip.

    v is the speed of the rear axle, x and y belong to the centre of mass; the
    lateral velocity there is l_r omega with omega = v tan(d) / wheelbase.
    """
    f = adapt(xp)
    sin = f.sin
    cos = f.cos
    l_r = p.body.l_r
    per_wheelbase = 1.0 / p.body.wheelbase
    per_mass = 1.0 / p.body.mass
    friction = make_friction(p.friction, f)
    limit = make_force_limit(p.motor, f)

    def rates(eta: Value, v: Value, k0: Value, k1: Value, brake: Value,
              td: Value) -> tuple[Value, Value, Value, Value]:
        # No slip: the rear axle moves along the car, the front axle along its wheels. The centre of
        # mass is l_r ahead of the rear axle, so it moves sideways at l_r omega (DART paper,
        # kinematic bicycle, whose reference point is the rear axle).
        om = v * td * per_wheelbase
        vy = l_r * om
        ce = cos(eta)
        se = sin(eta)
        return (v * ce - vy * se, v * se + vy * ce, om,
                (limit(k0 - k1 * v) + friction(v, brake)) * per_mass)

    return rates


def make_acceleration(p: Vehicle, xp: Any = math,
                      slip: str | None = None) -> Callable[..., tuple[Value, Value, Value]]:
    """Return ``acceleration(v_x, v_y, omega, tau, delta) -> (v_x', v_y', omega')``.

    The equations of ``make_dynamic`` with the inputs of the paper: throttle tau -1..1 at the ESC,
    or the commanded speed [m/s] of a speed loop, and road-wheel angle delta [rad].
    """
    f = adapt(xp)
    p = apply_parameter_effects(p)
    rates = make_dynamic(p, f, slip)
    gains = make_drive_gains(p.motor, f)

    def acceleration(vx: Value, vy: Value, om: Value, tau: Value,
                     delta: Value) -> tuple[Value, Value, Value]:
        k0, k1 = gains(tau)
        full = rates(0.0, vx, vy, om, k0, k1, 0.0, f.cos(delta), f.sin(delta))
        return full[3], full[4], full[5]

    return acceleration
