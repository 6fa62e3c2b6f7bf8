"""The whole car from command to pose: one step of actuators and bicycle.

``make_car_step`` has the actuator lags as two more states. ``make_motion_step`` takes the outputs
of the actuators as inputs, sample by sample. Both have the same signature for the dynamic and the
kinematic bicycle.

A lag T with a constant command u over a step dt is solved exactly, at its middle and its end:

    s(dt/2) = u + h (s(0) - u),     s(dt) = u + h^2 (s(0) - u),     h = exp(-dt / (2 T))
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.vehicle.bicycle import make_dynamic, make_kinematic
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.integrate import (
    MAX_RELAXATION,
    Inputs,
    State6,
    make_dynamic_euler,
    make_dynamic_midpoint,
    make_dynamic_step,
    make_kinematic_euler,
    make_kinematic_midpoint,
    make_kinematic_step,
)
from dart_hal.vehicle.motor import make_drive_gains
from dart_hal.vehicle.namespace import Namespace, Value, adapt
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

# By method: makers of the integrators of the dynamic and of the kinematic bicycle.
Methods = Mapping[str, tuple[Callable[..., Any], Callable[..., Any]]]
METHODS: Methods = {"rk4": (make_dynamic_step, make_kinematic_step),
                    "midpoint": (make_dynamic_midpoint, make_kinematic_midpoint),
                    "euler": (make_dynamic_euler, make_kinematic_euler)}
# s; scale below which a lag counts as none. The transition is smooth: no branch on a parameter.
MIN_LAG = 1e-6

State8 = tuple[Value, Value, Value, Value, Value, Value, Value, Value]
State9 = tuple[Value, Value, Value, Value, Value, Value, Value, Value, Value]
# ``body(x, y, eta, v_x, v_y, omega, dt, start, middle, end)``; the last three (tau, delta).
Body6 = Callable[..., State6]


def make_car_step(p: Vehicle, xp: Any = math, dt: Value = SAMPLE, method: str = "rk4",
                  methods: Methods = METHODS) -> Callable[..., State8]:
    """Return ``step(x, y, eta, v_x, v_y, omega, tau, s, tau_command, s_command) -> state``.

    State of the centre of mass [m, rad, m/s, rad/s], then throttle tau and steering s at the
    outputs of the actuators (-1..1; tau of a speed loop in m/s; they lag behind the commands, which
    are constant over dt [s]). The caller applies pure delays: they are a queue of commands, not an
    equation. methods: integrators, METHODS or others of the same signature. Raises UsageError for
    an unknown method.
    """
    f = adapt(xp)
    p = apply_parameter_effects(p)
    body = _make_body_step(p, f, method, dt, methods)
    steering = make_steering(p.steering, f)
    (start_t, half_t), (start_s, half_s) = (
        lag_decay(lag, dt, f) for lag in (p.delay.throttle_lag_s, p.delay.steering_lag_s))

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, tau: Value,
             s: Value, tau_command: Value, s_command: Value) -> State8:
        # deviation from the command at the start and the middle, actuator output at the end
        t0 = start_t * (tau - tau_command)
        s0 = start_s * (s - s_command)
        t1 = half_t * t0
        s1 = half_s * s0
        t2 = tau_command + half_t * t1
        s2 = s_command + half_s * s1
        state = body(x, y, eta, vx, vy, om, dt,
                     (tau_command + t0, steering(s_command + s0)),
                     (tau_command + t1, steering(s_command + s1)), (t2, steering(s2)))
        return (*state, t2, s2)

    return step


def make_motion_step(p: Vehicle, xp: Any = math, dt: Value = 0.0025, substeps: int = 1,
                     method: str = "rk4", methods: Methods = METHODS) -> Callable[..., State6]:
    """Return ``step(x, y, eta, v_x, v_y, omega, tau, delta) -> state`` after substeps * dt [s].

    tau: throttle, or commanded speed, after gate, delay and lag; delta [rad]: road-wheel angle;
    both constant. methods: as in ``make_car_step``. Raises UsageError for an unknown method.
    """
    f = adapt(xp)
    p = apply_parameter_effects(p)
    inputs, advance, kinematic = _make_parts(p, f, method, dt, methods)

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, tau: Value,
             delta: Value) -> State6:
        held = inputs(tau, delta)
        for _ in range(substeps):
            x, y, eta, vx, vy, om = advance(x, y, eta, vx, vy, om, dt, held, held, held)
        return x, y, eta, vx, vy, om

    def kinematic_step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, tau: Value,
                       delta: Value) -> State6:
        held = inputs(tau, delta)
        for _ in range(substeps):
            x, y, eta, vx = advance(x, y, eta, vx, dt, held, held, held)
        return (x, y, eta, vx, *_no_slip_motion(p, vx, held[3]))

    return kinematic_step if kinematic else step


def make_tick_step(p: Vehicle, xp: Any = math, dt: Value = 0.001, method: str = "rk4"
                   ) -> Callable[..., State9]:
    """Return ``step(x, y, eta, v_x, v_y, omega, k0, k1, brake, cos d, sin d) -> state``.

    The dynamic bicycle over dt [s] with the drive force k0 - k1 v_x [N], the brake [N] and the
    road-wheel angle d of the caller. k0, k1 and brake are returned unchanged, after the motion.
    """
    f = adapt(xp)
    advance = METHODS[method][0](make_dynamic(p, f, max_rate=MAX_RELAXATION[method] / dt))

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, k0: Value, k1: Value,
             brake: Value, cos_d: Value, sin_d: Value) -> State9:
        held = k0, k1, brake, cos_d, sin_d
        return (*advance(x, y, eta, vx, vy, om, dt, held, held, held), k0, k1, brake)

    return step


def lag_decay(lag: Value, dt: Value, f: Namespace) -> tuple[Value, Value]:
    """Return (1 with a lag and 0 without, exp(-dt / (2 lag))); (0, 0) for a lag of 0 s."""
    return 1.0 - f.exp(-lag / MIN_LAG), f.exp(-0.5 * dt / f.fmax(lag, MIN_LAG))


def _make_parts(p: Vehicle, f: Namespace, method: str, dt: Value, methods: Methods
           ) -> tuple[Callable[[Value, Value], Inputs], Callable[..., Any], bool]:
    """Return (tau, delta) -> inputs of the rates, the integrator, and if the car is kinematic."""
    if method not in methods:
        raise UsageError(f"no integration method {method!r}", expected=", ".join(methods))
    gains = make_drive_gains(p.motor, f)
    sin = f.sin
    cos = f.cos
    tan = f.tan
    make_dynamic_integrator, make_kinematic_integrator = methods[method]

    def dynamic_inputs(tau: Value, delta: Value) -> Inputs:
        k0, k1 = gains(tau)
        return k0, k1, 0.0, cos(delta), sin(delta)

    def kinematic_inputs(tau: Value, delta: Value) -> Inputs:
        k0, k1 = gains(tau)
        return k0, k1, 0.0, tan(delta)

    if p.kind == "kinematic":
        return kinematic_inputs, make_kinematic_integrator(make_kinematic(p, f)), True
    rates = make_dynamic(p, f, max_rate=MAX_RELAXATION[method] / dt)
    return dynamic_inputs, make_dynamic_integrator(rates), False


def _make_body_step(p: Vehicle, f: Namespace, method: str, step: Value,
                    methods: Methods) -> Body6:
    inputs, advance, kinematic = _make_parts(p, f, method, step, methods)

    def dynamic(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, dt: Value,
                start: Inputs, middle: Inputs, end: Inputs) -> State6:
        state: State6 = advance(x, y, eta, vx, vy, om, dt, inputs(*start), inputs(*middle),
                                inputs(*end))
        return state

    def roll(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, dt: Value,
             start: Inputs, middle: Inputs, end: Inputs) -> State6:
        last = inputs(*end)
        x, y, eta, vx = advance(x, y, eta, vx, dt, inputs(*start), inputs(*middle), last)
        return (x, y, eta, vx, *_no_slip_motion(p, vx, last[3]))

    return roll if kinematic else dynamic


def _no_slip_motion(p: Vehicle, vx: Value, tan_delta: Value) -> tuple[Value, Value]:
    """Return (v_y, omega) of the centre of mass without tyre slip."""
    om = vx * tan_delta / p.body.wheelbase
    return p.body.l_r * om, om
