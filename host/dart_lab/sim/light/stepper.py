"""Equations of motion over one step, with substeps near standstill.

The force of a tyre depends on its slip angle, which grows as 1/v for a given lateral speed. Near
standstill the equations are therefore stiff, and a step of 10 ms would be unstable. Below some
speed a car takes several substeps. This speed and their number depend on the vehicle. A car in a
batch decides by its own speed, so it moves as it would alone.
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

# Largest product of rate and step for RK4, half of it for Euler; they are stable up to 2.78 and 2.
MAX_RATE_STEP = 2.0
# Largest speed for which the divisor of the slip angle is tabulated [m/s].
MAX_DIVISOR_SPEED = 5.0

State8 = tuple[Value, ...]
Stepper = Callable[[State8, Value, Value], State8]


@dataclass(frozen=True, slots=True)
class Substeps:
    """Below ``speed`` [m/s] a step has ``parts`` substeps; arrays for a stack of vehicles."""

    speed: Value
    parts: Value


def find_substeps(p: Vehicle, step: float, method: str = "rk4", xp: Any = np) -> Substeps:
    """Return the substeps for steps of ``step`` s near standstill.

    1. The fastest rate of the lateral equations, linear in the slip angle, is
       stiffness / divisor(speed). At standstill it is also that of the friction.
    2. ``speed`` is the lowest speed from which on the rate is below the limit, else inf.
    3. ``parts`` is the ratio of the fastest rate to the limit.
    """
    p = apply_parameter_effects(p)
    limit = (MAX_RATE_STEP if method == "rk4" else 0.5 * MAX_RATE_STEP) / step
    still = p.friction.a * p.friction.b / p.body.mass
    stiff = _stiffness(p, xp) if p.kind == "dynamic" else 0.0 * still
    divisor = _divisors(p.slip)
    fastest = xp.maximum(still, stiff / divisor[0])
    # First entry of the table from which on the rate is below the limit.
    slow = xp.searchsorted(divisor, stiff / limit)
    speed = xp.where(still > limit, math.inf, xp.where(slow < len(divisor), 0.01 * slow, math.inf))
    parts = xp.maximum(1, xp.ceil(fastest / limit)).astype(int)
    if xp is not np or np.ndim(parts):
        return Substeps(speed, parts)
    return Substeps(float(speed), int(parts))


@lru_cache(maxsize=8)
def _divisors(form: str) -> FloatArray:
    """Return the smallest divisor of the slip angle from each 0.01 m/s upwards [m/s]."""
    # The divisor is independent of the body.
    slip = make_slip(PAPER.body, math, form)
    grid = [0.01 * k for k in range(round(MAX_DIVISOR_SPEED / 0.01) + 1)]
    divisor = np.array([1e-6 / abs(slip(v, -1e-6, 0.0, 1.0, 0.0)[1]) for v in grid])
    least: FloatArray = np.minimum.accumulate(divisor[::-1])[::-1]
    return least


def _stiffness(p: Vehicle, xp: Any) -> Value:
    """Return the fastest rate of (v_y, omega) at a divisor of 1 m/s [1/s]: an eigenvalue."""
    front, rear = (f(1e-6) / 1e-6 for f in make_tyres(p.tyres, p.body, xp))
    b = p.body
    across = (front + rear) / b.mass
    turning = (
        b.l_f**2 * front + b.l_r**2 * rear) / b.yaw_inertia
    coupling = (b.l_f * front - b.l_r * rear) ** 2 / (b.mass * b.yaw_inertia)
    return 0.5 * (across + turning + xp.sqrt((across - turning) ** 2 + 4.0 * coupling))


def make_scalar_stepper(p: Vehicle, step: float, method: str, substeps: Substeps,
                        kind: str = "car") -> Stepper:
    """Make ``stepper(state, throttle, steering) -> state`` for one car.

    kind "motion": without the actuators, six states, and an angle [rad] in
    place of the steering.
    """
    coarse = _step(p, math, step, method, kind)
    if substeps.parts == 1:
        return lambda state, tau, s: coarse(*state, tau, s)
    short = _step(p, math, step / substeps.parts, method, kind)
    speed = substeps.speed
    parts = range(substeps.parts)

    def stepper(state: State8, tau: Value, s: Value) -> State8:
        if -speed < state[3] < speed:
            for _ in parts:
                state = short(*state, tau, s)
            return state
        return coarse(*state, tau, s)

    return stepper


def make_array_stepper(p: Vehicle, step: float, method: str, substeps: Substeps,
                       dtype: str = "float64", engine: str = "auto",
                       kind: str = "car") -> Stepper:
    """Make the same for arrays of cars; parameters may be arrays of one value per car.

    engine: "native" (compiled), "numpy", or "auto" = native if there is a kernel. Both agree to
    1e-12 in float64. Raises UsageError for "native" without a kernel.
    """
    coarse = _over_arrays(p, step, method, dtype, engine, kind)
    if np.max(substeps.parts) == 1:
        return lambda state, tau, s: coarse(state, tau, s, 1, None)
    short = {m: _over_arrays(p, step / m, method, dtype, engine, kind)
             for m in np.unique(substeps.parts).tolist()}
    same = short[substeps.parts] if isinstance(substeps.parts, int) else None

    def stepper(state: State8, tau: Value, s: Value) -> State8:
        slow = np.flatnonzero(np.abs(state[3]) < substeps.speed)
        if same and len(slow) == len(state[3]):
            return same(state, tau, s, substeps.parts, None)
        new = coarse(state, tau, s, 1, None)
        for parts, steps in short.items():
            lanes = slow if same else slow[substeps.parts[slow] == parts]
            if len(lanes):
                slow_state = tuple(v[lanes] for v in state)
                result = steps(slow_state, tau[lanes], s[lanes], parts, lanes)
                for whole, part in zip(new, result, strict=True):
                    whole[lanes] = part
        return new

    return stepper


# ``steps(state, throttle, steering, times, lanes)``; lanes: indices of the cars in the arrays.
Arrays = Callable[[State8, Value, Value, int, Any], State8]


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
    step_all = _step(p, np, step, method, kind)
    parameters = {name: value(p, name) for name in names(p)}
    varied = any(np.ndim(v) for v in parameters.values())

    def steps(state: State8, tau: Value, s: Value, times: int, lanes: Any) -> State8:
        advance = step_all
        if lanes is not None and varied:
            advance = _step(bind(p, lambda name: (
                v[lanes] if np.ndim(v := parameters[name]) else v)), np, step, method, kind)
        for _ in range(times):
            state = advance(*state, tau, s)
        return tuple(np.asarray(v, dtype=dtype) for v in state)

    return steps
