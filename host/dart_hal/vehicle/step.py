"""The whole car from command to pose: one step of actuators and bicycle.

``make_car_step`` has the actuator lags as two more states; ``make_motion_step``
takes what the actuators did from outside, sample by sample. Both are the same
for the dynamic and the kinematic bicycle, so that a caller need not care.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.vehicle.bicycle import make_dynamic, make_kinematic
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.integrate import (
    RATES,
    Inputs,
    State6,
    make_dynamic_euler,
    make_dynamic_midpoint,
    make_dynamic_step,
    make_kinematic_euler,
    make_kinematic_midpoint,
    make_kinematic_step,
)
from dart_hal.vehicle.motor import make_motor_gains
from dart_hal.vehicle.namespace import Namespace, Value, adapt
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

METHODS = {"rk4": (make_dynamic_step, make_kinematic_step),
           "midpoint": (make_dynamic_midpoint, make_kinematic_midpoint),
           "euler": (make_dynamic_euler, make_kinematic_euler)}
NO_LAG = 1e-6
"""s; a lag of a few of these is one, a lag of 0 acts at once, without a branch."""

State8 = tuple[Value, Value, Value, Value, Value, Value, Value, Value]
Body6 = Callable[..., State6]
"""``body(x, y, eta, v_x, v_y, omega, dt, start, middle, end)``; each (tau, delta)."""


def make_car_step(p: Vehicle, xp: Any = math, dt: Value = SAMPLE,
                  method: str = "rk4") -> Callable[..., State8]:
    """``step(x, y, eta, v_x, v_y, omega, tau, s, tau_command, s_command) -> state``.

    State of the centre of mass [m, rad, m/s, rad/s], then throttle and steering
    as the actuators have them (-1..1, lagging behind the commands, which are
    held over dt [s]). The lags are solved exactly. Pure delays are the caller's:
    they are a queue of commands, not an equation. Raises UsageError for an
    unknown method.
    """
    f, p = adapt(xp), settled(p)
    body = _body(p, f, method, dt)
    steering = make_steering(p.steering, f)
    (start_t, half_t), (start_s, half_s) = (
        decay(lag, dt, f) for lag in (p.delay.throttle_lag_s, p.delay.steering_lag_s))

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, tau: Value,
             s: Value, tau_command: Value, s_command: Value) -> State8:
        t0, s0 = start_t * (tau - tau_command), start_s * (s - s_command)
        t1, s1 = half_t * t0, half_s * s0
        t2, s2 = tau_command + half_t * t1, s_command + half_s * s1
        state = body(x, y, eta, vx, vy, om, dt,
                     (tau_command + t0, steering(s_command + s0)),
                     (tau_command + t1, steering(s_command + s1)), (t2, steering(s2)))
        return (*state, t2, s2)

    return step


def make_motion_step(p: Vehicle, xp: Any = math, dt: Value = 0.0025, substeps: int = 1,
                     method: str = "rk4") -> Callable[..., State6]:
    """``step(x, y, eta, v_x, v_y, omega, tau, delta) -> state`` after substeps * dt [s].

    tau: throttle behind gate, delay and lag; delta [rad]: road-wheel angle;
    both held. Raises UsageError for an unknown method.
    """
    f, p = adapt(xp), settled(p)
    inputs, advance, kinematic = _parts(p, f, method, dt)

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, tau: Value,
             delta: Value) -> State6:
        held = inputs(tau, delta)
        for _ in range(substeps):
            x, y, eta, vx, vy, om = advance(x, y, eta, vx, vy, om, dt, held, held, held)
        return x, y, eta, vx, vy, om

    def rolled(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, tau: Value,
               delta: Value) -> State6:
        held = inputs(tau, delta)
        for _ in range(substeps):
            x, y, eta, vx = advance(x, y, eta, vx, dt, held, held, held)
        return (x, y, eta, vx, *_no_slip(p, vx, held[3]))

    return rolled if kinematic else step


def decay(lag: Value, dt: Value, f: Namespace) -> tuple[Value, Value]:
    """(1 with a lag and 0 without, share of a step that is left after dt/2 [s]); 0, 0 for 0 s."""
    return 1.0 - f.exp(-lag / NO_LAG), f.exp(-0.5 * dt / f.fmax(lag, NO_LAG))


def _parts(p: Vehicle, f: Namespace, method: str, dt: Value
           ) -> tuple[Callable[[Value, Value], Inputs], Callable[..., Any], bool]:
    """(inputs of the rates from (tau, delta), integrator with steps of dt [s], kinematic?)."""
    if method not in METHODS:
        raise UsageError(f"no integration method {method!r}", expected=", ".join(METHODS))
    gains = make_motor_gains(p.motor, f)
    sin, cos, tan = f.sin, f.cos, f.tan
    make_slipping, make_rolling = METHODS[method]

    def slipping(tau: Value, delta: Value) -> Inputs:
        k0, k1 = gains(tau)
        return k0, k1, 0.0, cos(delta), sin(delta)

    def rolling(tau: Value, delta: Value) -> Inputs:
        k0, k1 = gains(tau)
        return k0, k1, 0.0, tan(delta)

    if p.kind == "kinematic":
        return rolling, make_rolling(make_kinematic(p, f)), True
    return slipping, make_slipping(make_dynamic(p, f, max_rate=RATES[method] / dt)), False


def _body(p: Vehicle, f: Namespace, method: str, step: Value) -> Body6:
    inputs, advance, kinematic = _parts(p, f, method, step)

    def dynamic(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, dt: Value,
                start: Inputs, middle: Inputs, end: Inputs) -> State6:
        state: State6 = advance(x, y, eta, vx, vy, om, dt, inputs(*start), inputs(*middle),
                                inputs(*end))
        return state

    def rolled(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, dt: Value,
               start: Inputs, middle: Inputs, end: Inputs) -> State6:
        last = inputs(*end)
        x, y, eta, vx = advance(x, y, eta, vx, dt, inputs(*start), inputs(*middle), last)
        return (x, y, eta, vx, *_no_slip(p, vx, last[3]))

    return rolled if kinematic else dynamic


def _no_slip(p: Vehicle, vx: Value, tan_delta: Value) -> tuple[Value, Value]:
    """(v_y, omega) of the centre of mass when no tyre slips."""
    om = vx * tan_delta / p.body.wheelbase
    return p.body.l_r * om, om
