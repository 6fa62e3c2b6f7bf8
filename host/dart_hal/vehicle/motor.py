"""Force of the motor at the wheels, forward and in reverse."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Friction, Motor

SHARPNESS = 100.0
"""Of the smooth max(0, u): the blend is about 0.02 of throttle wide."""


def make_dead_band(g: float, xp: Any = math) -> Callable[[Value], Value]:
    """``dead_band(tau)``: smooth max(0, tau + g), g < 0."""
    tanh = adapt(xp).tanh

    def dead_band(tau: Value) -> Value:
        u = tau + g
        return 0.5 * u * (tanh(SHARPNESS * u) + 1.0)

    return dead_band


def make_motor_gains(p: Motor, xp: Any = math) -> Callable[[Value], tuple[Value, Value]]:
    """``gains(tau) -> (k0, k1)`` with force = k0 - k1 v.

    The throttle is constant over an integration step, so the dead band is
    evaluated once per step and the force costs one multiplication.
    """
    d, e, reverse = p.d, p.e, p.reverse
    dead_band = make_dead_band(p.g, xp)

    def gains(tau: Value) -> tuple[Value, Value]:
        forward = dead_band(tau)
        backward = reverse * dead_band(-tau)
        return d * (forward - backward), e * (forward + backward)

    return gains


def make_motor(p: Motor, xp: Any = math) -> Callable[[Value, Value], Value]:
    """``motor(tau, v) -> F`` [N] for throttle -1..1 and speed [m/s]."""
    gains = make_motor_gains(p, xp)

    def motor(tau: Value, v: Value) -> Value:
        k0, k1 = gains(tau)
        return k0 - k1 * v

    return motor


def make_drive(p: Motor, resistance: Friction, xp: Any = math) -> Callable[..., Value]:
    """``drive(tau, v, brake=0) -> F`` [N] at the wheels: motor and friction together."""
    motor, friction = make_motor(p, xp), make_friction(resistance, xp)

    def drive(tau: Value, v: Value, brake: Value = 0.0) -> Value:
        return motor(tau, v) + friction(v, brake)

    return drive
