"""Equations of motion over one step, fine enough near standstill.

A tyre's force follows its slip angle, and the angle of a given sideways speed
grows as 1/v: near standstill the equations are stiff, and a step of 10 ms would
be unstable there. So a car below some speed takes several short steps instead
of one. Which speed and how many follows from the vehicle; a car decides by its
own speed alone, so that it moves the same way alone and in a batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.vehicle import Vehicle, make_car_step, make_slip, make_tyres
from dart_hal.vehicle.flat import bind, value
from dart_hal.vehicle.namespace import Value

STABLE = 2.0
"""Largest rate times step that is allowed; RK4 is stable up to 2.78, Euler to 2."""
FASTEST = 5.0

State8 = tuple[Value, ...]
Stepper = Callable[[State8, Value, Value], State8]


@dataclass(frozen=True, slots=True)
class Fineness:
    """Below ``speed`` [m/s] a step is divided by ``parts``."""

    speed: float
    parts: int


def fineness(p: Vehicle, step: float, method: str = "rk4") -> Fineness:
    """How finely steps of ``step`` s must be divided near standstill.

    From the fastest rate of the lateral equations, linear in the slip angle.
    A vehicle that is too stiff at all speeds is divided everywhere (speed inf).
    """
    limit = STABLE if method == "rk4" else 0.5 * STABLE
    still = p.friction.a * p.friction.b / p.body.mass
    stiff = _stiffness(p) if p.kind == "dynamic" else 0.0
    slip = make_slip(p.body, math, p.slip)
    grid = [0.01 * k for k in range(round(FASTEST / 0.01) + 1)]
    rates = [max(still, stiff * abs(slip(v, -1e-6, 0.0, 1.0, 0.0)[1]) / 1e-6) for v in grid]
    parts = max(1, math.ceil(max(rates) * step / limit))
    slow = [v for v, rate in zip(grid, rates, strict=True) if rate * step > limit]
    speed = 0.0 if not slow else (math.inf if slow[-1] >= FASTEST else slow[-1] + 0.01)
    return Fineness(speed, parts)


def _stiffness(p: Vehicle) -> float:
    """Fastest rate of (v_y, omega) at an effective speed of 1 m/s [1/s]."""
    front, rear = (f(1e-6) / 1e-6 for f in make_tyres(p.tyres, p.body))
    b = p.body
    coupling = b.l_f * front - b.l_r * rear
    matrix = np.array([[(front + rear) / b.mass, coupling / b.mass],
                       [coupling / b.yaw_inertia,
                        (b.l_f**2 * front + b.l_r**2 * rear) / b.yaw_inertia]])
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def make_scalar_stepper(p: Vehicle, step: float, method: str, fine: Fineness) -> Stepper:
    """``stepper(state, throttle, steering) -> state`` for one car."""
    coarse = make_car_step(p, math, step, method)
    if fine.parts == 1:
        return lambda state, tau, s: coarse(*state, tau, s)
    short = make_car_step(p, math, step / fine.parts, method)
    speed, parts = fine.speed, range(fine.parts)

    def stepper(state: State8, tau: Value, s: Value) -> State8:
        if -speed < state[3] < speed:
            for _ in parts:
                state = short(*state, tau, s)
            return state
        return coarse(*state, tau, s)

    return stepper


def make_array_stepper(p: Vehicle, step: float, method: str, fine: Fineness) -> Stepper:
    """The same for arrays of cars; parameters may be arrays, a value for each."""
    coarse = make_car_step(p, np, step, method)
    if fine.parts == 1:
        return lambda state, tau, s: coarse(*state, tau, s)
    short = make_car_step(p, np, step / fine.parts, method)

    def stepper(state: State8, tau: Value, s: Value) -> State8:
        slow = np.flatnonzero(np.abs(state[3]) < fine.speed)
        if len(slow) == len(state[3]):
            return _repeat(short, state, tau, s, fine.parts)
        new = coarse(*state, tau, s)
        if len(slow):
            some = make_car_step(_lanes(p, slow), np, step / fine.parts, method)
            crept = _repeat(some, tuple(v[slow] for v in state), tau[slow], s[slow], fine.parts)
            for whole, part in zip(new, crept, strict=True):
                whole[slow] = part
        return new

    return stepper


def _repeat(step: Callable[..., State8], state: State8, tau: Value, s: Value,
            times: int) -> State8:
    for _ in range(times):
        state = step(*state, tau, s)
    return state


def _lanes(p: Vehicle, lanes: Any) -> Vehicle:
    """The vehicles of some lanes of a stacked one."""
    def of(name: str) -> Value:
        v = value(p, name)
        return v[lanes] if isinstance(v, np.ndarray) else v

    return bind(p, of)
