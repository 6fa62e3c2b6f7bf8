"""Force of the motor at the wheels, forward and in reverse.

    F(tau, v) = (d - e v) T(tau) - reverse (d + e v) T(-tau)
    T(tau)    = smooth max(0, tau + g)
              = (tau + g) (tanh(100 (tau + g)) + 1) / 2

g < 0 is the dead band of the ESC, d the force per throttle at rest, e its loss per speed by the
back EMF. The forward part is that of the DART paper.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Friction, Motor

# Steepness of the smooth max(0, u). The transition is about 2 / 100 = 0.02 of throttle wide.
SHARPNESS = 100.0


def make_dead_band(g: float, xp: Any = math) -> Callable[[Value], Value]:
    """Return ``dead_band(tau)``: smooth max(0, tau + g), g < 0."""
    tanh = adapt(xp).tanh

    def dead_band(tau: Value) -> Value:
        u = tau + g
        return 0.5 * u * (tanh(SHARPNESS * u) + 1.0)

    return dead_band


def make_motor_gains(p: Motor, xp: Any = math) -> Callable[[Value], tuple[Value, Value]]:
    """Return ``gains(tau) -> (k0, k1)`` with force = k0 - k1 v.

    The throttle is constant over an integration step, so the dead band is
    evaluated once per step and the force costs one multiplication.
    """
    d = p.d
    e = p.e
    reverse = p.reverse
    dead_band = make_dead_band(p.g, xp)

    def gains(tau: Value) -> tuple[Value, Value]:
        forward = dead_band(tau)
        backward = reverse * dead_band(-tau)
        return d * (forward - backward), e * (forward + backward)

    return gains


def make_motor(p: Motor, xp: Any = math) -> Callable[[Value, Value], Value]:
    """Return ``motor(tau, v) -> F`` [N] for throttle -1..1 and speed [m/s]."""
    gains = make_motor_gains(p, xp)

    def motor(tau: Value, v: Value) -> Value:
        k0, k1 = gains(tau)
        return k0 - k1 * v

    return motor


def make_drive(p: Motor, resistance: Friction, xp: Any = math) -> Callable[..., Value]:
    """Return ``drive(tau, v, brake=0) -> F`` [N] at the wheels: motor and friction."""
    motor = make_motor(p, xp)
    friction = make_friction(resistance, xp)

    def drive(tau: Value, v: Value, brake: Value = 0.0) -> Value:
        return motor(tau, v) + friction(v, brake)

    return drive
