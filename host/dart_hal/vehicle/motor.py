"""Force of the motor at the wheels, forward and in reverse.

Two forms. A motor of duty, commanded by the throttle tau -1..1 of an ESC:

    F(tau, v) = (d - e v) T(tau) - reverse (d + e v) T(-tau)
    T(tau)    = smooth max(0, tau + g)
              = (tau + g) (tanh(100 (tau + g)) + 1) / 2

g < 0 is the dead band of the ESC, d the force per throttle at rest, e its loss per speed by the
back EMF. The forward part is that of the DART paper.

A speed loop, commanded by a speed u [m/s] of a VESC or another controller:

    F(u, v) = clip(K (u - v), -F_max, F_max)

The clip is exact, not smooth: fits use differences of rollouts, in which a corner averages out.
Both forms are F = limit(k0 - k1 v) with k0, k1 of the command alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Friction, Motor, SpeedLoop, require_duty

# Steepness of the smooth max(0, u). The transition is about 2 / 100 = 0.02 of throttle wide.
SHARPNESS = 100.0


def make_dead_band(g: float, xp: Any = math) -> Callable[[Value], Value]:
    """Return ``dead_band(tau)``: smooth max(0, tau + g), g < 0."""
    tanh = adapt(xp).tanh

    def dead_band(tau: Value) -> Value:
        u = tau + g
        return 0.5 * u * (tanh(SHARPNESS * u) + 1.0)

    return dead_band


def make_motor_gains(p: Motor | SpeedLoop, xp: Any = math
                     ) -> Callable[[Value], tuple[Value, Value]]:
    """Return ``gains(tau) -> (k0, k1)`` of a motor of duty, with force = k0 - k1 v.

    The throttle is constant over an integration step, so the dead band is
    evaluated once per step and the force costs one multiplication. Raises UsageError for a
    speed loop, whose force is limited besides: ``make_drive_gains``.
    """
    p = require_duty(p)
    d = p.d
    e = p.e
    reverse = p.reverse
    dead_band = make_dead_band(p.g, xp)

    def gains(tau: Value) -> tuple[Value, Value]:
        # (d - e v) T(tau) - reverse (d + e v) T(-tau), sorted by powers of v:
        #     k0 = d (T(tau) - reverse T(-tau)),  k1 = e (T(tau) + reverse T(-tau))
        forward = dead_band(tau)
        backward = reverse * dead_band(-tau)
        return d * (forward - backward), e * (forward + backward)

    return gains


def make_drive_gains(p: Motor | SpeedLoop, xp: Any = math
                     ) -> Callable[[Value], tuple[Value, Value]]:
    """Return ``gains(u) -> (k0, k1)`` of either form, with force = limit(k0 - k1 v).

    u: throttle -1..1, or commanded speed [m/s]; limit: that of ``make_force_limit``.
    """
    if isinstance(p, Motor):
        return make_motor_gains(p, xp)
    # K (u - v): k0 = K u, k1 = K.
    gain = p.gain
    return lambda u: (gain * u, gain)


def make_force_limit(p: Motor | SpeedLoop, xp: Any = math) -> Callable[[Value], Value]:
    """Return ``limit(F) -> F`` [N]: the clip of a speed loop; a motor of duty has none."""
    if isinstance(p, Motor):
        return lambda force: force
    f = adapt(xp)
    most = p.max_force
    return lambda force: f.fmin(f.fmax(force, -most), most)


def make_motor(p: Motor | SpeedLoop, xp: Any = math) -> Callable[[Value, Value], Value]:
    """Return ``motor(u, v) -> F`` [N] for throttle -1..1, or commanded speed, and speed [m/s]."""
    gains = make_drive_gains(p, xp)
    limit = make_force_limit(p, xp)

    def motor(u: Value, v: Value) -> Value:
        k0, k1 = gains(u)
        return limit(k0 - k1 * v)

    return motor


def make_drive(p: Motor | SpeedLoop, resistance: Friction, xp: Any = math) -> Callable[..., Value]:
    """Return ``drive(tau, v, brake=0) -> F`` [N] at the wheels: motor and friction."""
    motor = make_motor(p, xp)
    friction = make_friction(resistance, xp)

    def drive(tau: Value, v: Value, brake: Value = 0.0) -> Value:
        return motor(tau, v) + friction(v, brake)

    return drive
