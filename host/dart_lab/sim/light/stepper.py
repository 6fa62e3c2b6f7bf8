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
from functools import lru_cache
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle import (
    PAPER,
    Vehicle,
    make_car_step,
    make_motion_step,
    make_slip,
    make_tyres,
)
from dart_hal.vehicle.batch import prepare
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.flat import bind, names, value
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.native.call import align_coefficients, call
from dart_hal.vehicle.native.kernel import CompiledStep

STABLE = 2.0
"""Largest rate times step that is allowed; RK4 is stable up to 2.78, Euler to 2."""
FASTEST = 5.0

State8 = tuple[Value, ...]
Stepper = Callable[[State8, Value, Value], State8]


@dataclass(frozen=True, slots=True)
class Fineness:
    """Below ``speed`` [m/s] a step is divided by ``parts``; arrays for a stack of vehicles."""

    speed: Value
    parts: Value


def fineness(p: Vehicle, step: float, method: str = "rk4") -> Fineness:
    """How finely steps of ``step`` s must be divided near standstill.

    From the fastest rate of the lateral equations, linear in the slip angle. A
    vehicle that is too stiff at all speeds is divided everywhere (speed inf).
    """
    p = apply_parameter_effects(p)
    limit = (STABLE if method == "rk4" else 0.5 * STABLE) / step
    still = p.friction.a * p.friction.b / p.body.mass
    stiff = _stiffness(p) if p.kind == "dynamic" else 0.0 * still
    divisor = _divisors(p.slip)
    fastest = np.maximum(still, stiff / divisor[0])
    slow = np.searchsorted(divisor, stiff / limit)      # none of the rates is too fast from there
    speed = np.where(still > limit, math.inf, np.where(slow < len(divisor), 0.01 * slow, math.inf))
    parts = np.maximum(1, np.ceil(fastest / limit)).astype(int)
    return Fineness(speed, parts) if np.ndim(parts) else Fineness(float(speed), int(parts))


@lru_cache(maxsize=8)
def _divisors(form: str) -> FloatArray:
    """What the slip angle is divided by, at least, from each 0.01 m/s upwards [m/s]."""
    slip = make_slip(PAPER.body, math, form)            # the divisor knows no body
    grid = [0.01 * k for k in range(round(FASTEST / 0.01) + 1)]
    divisor = np.array([1e-6 / abs(slip(v, -1e-6, 0.0, 1.0, 0.0)[1]) for v in grid])
    least: FloatArray = np.minimum.accumulate(divisor[::-1])[::-1]
    return least


def _stiffness(p: Vehicle) -> Value:
    """Fastest rate of (v_y, omega) at a divisor of 1 m/s [1/s]: the larger eigenvalue."""
    front, rear = (f(1e-6) / 1e-6 for f in make_tyres(p.tyres, p.body, np))
    b = p.body
    across, turning = (front + rear) / b.mass, (
        b.l_f**2 * front + b.l_r**2 * rear) / b.yaw_inertia
    coupling = (b.l_f * front - b.l_r * rear) ** 2 / (b.mass * b.yaw_inertia)
    return 0.5 * (across + turning + np.sqrt((across - turning) ** 2 + 4.0 * coupling))


def make_scalar_stepper(p: Vehicle, step: float, method: str, fine: Fineness,
                        kind: str = "car") -> Stepper:
    """``stepper(state, throttle, steering) -> state`` for one car.

    kind "motion": without the actuators, six states, and an angle [rad] in
    place of the steering.
    """
    coarse = _step(p, math, step, method, kind)
    if fine.parts == 1:
        return lambda state, tau, s: coarse(*state, tau, s)
    short = _step(p, math, step / fine.parts, method, kind)
    speed, parts = fine.speed, range(fine.parts)

    def stepper(state: State8, tau: Value, s: Value) -> State8:
        if -speed < state[3] < speed:
            for _ in parts:
                state = short(*state, tau, s)
            return state
        return coarse(*state, tau, s)

    return stepper


def make_array_stepper(p: Vehicle, step: float, method: str, fine: Fineness,
                       dtype: str = "float64", engine: str = "auto",
                       kind: str = "car") -> Stepper:
    """The same for arrays of cars; parameters may be arrays, a value for each.

    engine: "native" (compiled), "numpy", or "auto" = native where there is a
    kernel; the two agree to 1e-12 in float64. Raises UsageError when "native"
    is wanted and there is none.
    """
    coarse = _over_arrays(p, step, method, dtype, engine, kind)
    if np.max(fine.parts) == 1:
        return lambda state, tau, s: coarse(state, tau, s, 1, None)
    short = {m: _over_arrays(p, step / m, method, dtype, engine, kind)
             for m in np.unique(fine.parts).tolist()}
    same = short[fine.parts] if isinstance(fine.parts, int) else None

    def stepper(state: State8, tau: Value, s: Value) -> State8:
        slow = np.flatnonzero(np.abs(state[3]) < fine.speed)
        if same and len(slow) == len(state[3]):
            return same(state, tau, s, fine.parts, None)
        new = coarse(state, tau, s, 1, None)
        for parts, steps in short.items():
            lanes = slow if same else slow[fine.parts[slow] == parts]
            if len(lanes):
                crept = steps(tuple(v[lanes] for v in state), tau[lanes], s[lanes], parts, lanes)
                for whole, part in zip(new, crept, strict=True):
                    whole[lanes] = part
        return new

    return stepper


Arrays = Callable[[State8, Value, Value, int, Any], State8]
"""``steps(state, throttle, steering, times, lanes)``; lanes: which cars the arrays hold."""


def _step(p: Vehicle, xp: Any, step: float, method: str, kind: str) -> Callable[..., State8]:
    if kind == "motion":
        return make_motion_step(p, xp, step, 1, method)
    return make_car_step(p, xp, step, method)


def _over_arrays(p: Vehicle, step: float, method: str, dtype: str, engine: str,
                 kind: str) -> Arrays:
    kernel = prepare(p, kind, step, dtype, method, engine)
    return _numpy(p, step, method, dtype, kind) if kernel is None else _native(kernel)


def _native(kernel: CompiledStep) -> Arrays:
    def steps(state: State8, tau: Value, s: Value, times: int, lanes: Any) -> State8:
        h = kernel.h
        if lanes is not None and h.ndim == 2:
            h = align_coefficients(h[:, lanes], h.dtype)
        new: State8 = tuple(call(kernel.run, h, np.asarray(state), tau[None], s[None], [1],
                                 times, None)[0])
        return new

    return steps


def _numpy(p: Vehicle, step: float, method: str, dtype: str, kind: str) -> Arrays:
    of_all = _step(p, np, step, method, kind)
    of = {name: value(p, name) for name in names(p)}
    varied = any(np.ndim(v) for v in of.values())

    def steps(state: State8, tau: Value, s: Value, times: int, lanes: Any) -> State8:
        advance = of_all
        if lanes is not None and varied:
            advance = _step(bind(p, lambda name: (
                v[lanes] if np.ndim(v := of[name]) else v)), np, step, method, kind)
        for _ in range(times):
            state = advance(*state, tau, s)
        return tuple(np.asarray(v, dtype=dtype) for v in state)

    return steps
