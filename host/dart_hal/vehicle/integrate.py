"""Explicit Runge-Kutta of fourth, second and first order, unrolled: no loop or list in a step.

With x' = f(x, u) and the inputs u_0, u_m, u_1 at the start, the middle and the end of a step dt:

    RK4:       a = f(x, u_0),           b = f(x + a dt/2, u_m)
               c = f(x + b dt/2, u_m),  d = f(x + c dt, u_1)
               x + (a + 2 (b + c) + d) dt/6
    midpoint:  x + f(x + f(x, u_0) dt/2, u_m) dt
    Euler:     x + f(x, u_0) dt

Inputs are tuples, so the response of the actuators is integrated to the same order; for constant
inputs the same tuple is passed three times. Position does not act on the motion, so it is only
summed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.namespace import Value

# Fastest relaxation rate r of the lateral motion that a method integrates, as z = r dt. One step
# multiplies a mode by
#     RK4:       1 - z + z^2/2 - z^3/6 + z^4/24     unstable above z = 2.785
#     midpoint:  1 - z + z^2/2                      unstable above z = 2
#     Euler:     1 - z                              unstable above z = 2
# At these values the factors are 0.56, 0.68 and 0: no mode changes its sign, and the margin of at
# least 1.16 is for forces that an effect makes stiffer.
MAX_RELAXATION = {"rk4": 2.4, "midpoint": 1.6, "euler": 1.0}

State6 = tuple[Value, Value, Value, Value, Value, Value]
State4 = tuple[Value, Value, Value, Value]
Inputs = tuple[Value, ...]


def make_dynamic_step(rates: Callable[..., Any]) -> Callable[..., State6]:
    """Return ``step(x, y, eta, v_x, v_y, omega, dt, start, middle, end) -> state`` after dt [s].

    ``rates`` is that of ``bicycle.make_dynamic``; the last three are its inputs
    (k0, k1, brake, cos d, sin d).
    """

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, dt: Value,
             start: Inputs, middle: Inputs, end: Inputs) -> State6:
        h = 0.5 * dt
        s = dt / 6.0
        a0, a1, a2, a3, a4, a5 = rates(eta, vx, vy, om, *start)
        b0, b1, b2, b3, b4, b5 = rates(eta + h * a2, vx + h * a3, vy + h * a4, om + h * a5,
                                       *middle)
        c0, c1, c2, c3, c4, c5 = rates(eta + h * b2, vx + h * b3, vy + h * b4, om + h * b5,
                                       *middle)
        d0, d1, d2, d3, d4, d5 = rates(eta + dt * c2, vx + dt * c3, vy + dt * c4, om + dt * c5,
                                       *end)
        return (x + s * (a0 + 2.0 * (b0 + c0) + d0), y + s * (a1 + 2.0 * (b1 + c1) + d1),
                eta + s * (a2 + 2.0 * (b2 + c2) + d2), vx + s * (a3 + 2.0 * (b3 + c3) + d3),
                vy + s * (a4 + 2.0 * (b4 + c4) + d4), om + s * (a5 + 2.0 * (b5 + c5) + d5))

    return step


def make_kinematic_step(rates: Callable[..., Any]) -> Callable[..., State4]:
    """Return ``step(x, y, eta, v, dt, start, middle, end) -> state`` after dt [s].

    ``rates`` is that of ``bicycle.make_kinematic``, inputs (k0, k1, brake, tan d).
    """

    def step(x: Value, y: Value, eta: Value, v: Value, dt: Value, start: Inputs, middle: Inputs,
             end: Inputs) -> State4:
        h = 0.5 * dt
        s = dt / 6.0
        a0, a1, a2, a3 = rates(eta, v, *start)
        b0, b1, b2, b3 = rates(eta + h * a2, v + h * a3, *middle)
        c0, c1, c2, c3 = rates(eta + h * b2, v + h * b3, *middle)
        d0, d1, d2, d3 = rates(eta + dt * c2, v + dt * c3, *end)
        return (x + s * (a0 + 2.0 * (b0 + c0) + d0), y + s * (a1 + 2.0 * (b1 + c1) + d1),
                eta + s * (a2 + 2.0 * (b2 + c2) + d2), v + s * (a3 + 2.0 * (b3 + c3) + d3))

    return step


def make_dynamic_midpoint(rates: Callable[..., Any]) -> Callable[..., State6]:
    """Return a step as ``make_dynamic_step`` does, of second order: half the evaluations."""

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, dt: Value,
             start: Inputs, middle: Inputs, end: Inputs) -> State6:
        h = 0.5 * dt
        _, _, a2, a3, a4, a5 = rates(eta, vx, vy, om, *start)
        b0, b1, b2, b3, b4, b5 = rates(eta + h * a2, vx + h * a3, vy + h * a4, om + h * a5,
                                       *middle)
        return (x + dt * b0, y + dt * b1, eta + dt * b2, vx + dt * b3, vy + dt * b4,
                om + dt * b5)

    return step


def make_kinematic_midpoint(rates: Callable[..., Any]) -> Callable[..., State4]:
    """Return a step as ``make_kinematic_step`` does, of second order."""

    def step(x: Value, y: Value, eta: Value, v: Value, dt: Value, start: Inputs, middle: Inputs,
             end: Inputs) -> State4:
        h = 0.5 * dt
        _, _, a2, a3 = rates(eta, v, *start)
        b0, b1, b2, b3 = rates(eta + h * a2, v + h * a3, *middle)
        return x + dt * b0, y + dt * b1, eta + dt * b2, v + dt * b3

    return step


def make_dynamic_euler(rates: Callable[..., Any]) -> Callable[..., State6]:
    """Return a step as ``make_dynamic_step`` does, of first order: one evaluation of the rates."""

    def step(x: Value, y: Value, eta: Value, vx: Value, vy: Value, om: Value, dt: Value,
             start: Inputs, middle: Inputs, end: Inputs) -> State6:
        a0, a1, a2, a3, a4, a5 = rates(eta, vx, vy, om, *start)
        return (x + dt * a0, y + dt * a1, eta + dt * a2, vx + dt * a3, vy + dt * a4,
                om + dt * a5)

    return step


def make_kinematic_euler(rates: Callable[..., Any]) -> Callable[..., State4]:
    """Return a step as ``make_kinematic_step`` does, of first order."""

    def step(x: Value, y: Value, eta: Value, v: Value, dt: Value, start: Inputs, middle: Inputs,
             end: Inputs) -> State4:
        a0, a1, a2, a3 = rates(eta, v, *start)
        return x + dt * a0, y + dt * a1, eta + dt * a2, v + dt * a3

    return step
