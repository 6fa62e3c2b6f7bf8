"""Wheel and tyre forces from the measured motion: the equations of motion, solved for forces."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Vehicle


def make_inverse_dynamics(p: Vehicle, xp: Any = math) -> Callable[..., tuple[Value, Value, Value]]:
    """Return ``forces(a_x, a_y, omega', delta) -> (F_w, F_yf, F_yr)`` [N].

    a_x, a_y [m/s2]: acceleration of the centre of mass along the body axes
    (v_x' - omega v_y and v_y' + omega v_x), omega' [rad/s2], delta [rad].
    F_w: force of all wheels along their tyres, F_yf and F_yr: lateral tyre
    forces in the frame of each tyre. The exact solution of

        [c_f cos d + c_r  -sin d     0 ] [F_w ]   [m a_x   ]
        [c_f sin d         cos d     1 ] [F_yf] = [m a_y   ]
        [l_f c_f sin d     l_f cos d -l_r] [F_yr]   [I omega']

    with c_f, c_r the share of each axle in F_w. The matrix is singular only for cos d =
    -c_f / c_r, beyond every steering stop. The paper divides by m and I_z on the right, and sets
    the front wheel force to m a_x / 2, without the longitudinal part of the front tyre's lateral
    force.
    """
    f = adapt(xp)
    sin = f.sin
    cos = f.cos
    mass = p.body.mass
    inertia = p.body.yaw_inertia
    l_f = p.body.l_f
    l_r = p.body.l_r
    per_wheelbase = 1.0 / p.body.wheelbase
    share_f = p.body.front_share
    share_r = 1.0 - p.body.front_share

    def forces(ax: Value, ay: Value, om_dot: Value, delta: Value) -> tuple[Value, Value, Value]:
        sd = sin(delta)
        cd = cos(delta)
        forward = mass * ax
        side = mass * ay
        moment = inertia * om_dot
        # lateral force of each axle in body axes, from the sums of forces and moments
        rear = (l_f * side - moment) * per_wheelbase
        front = (l_r * side + moment) * per_wheelbase
        # F_w and F_yf remain, in two equations: forces along the car, and the front axle to the
        # side.
        #     F_w (c_f cos d + c_r) - F_yf sin d = m a_x,   F_w c_f sin d + F_yf cos d = front
        # Cramer's rule; the determinant is c_f + c_r cos d.
        per_det = 1.0 / (share_f + share_r * cd)
        return ((forward * cd + front * sd) * per_det,
                ((share_f * cd + share_r) * front - share_f * sd * forward) * per_det, rear)

    return forces
