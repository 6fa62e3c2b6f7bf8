"""How a point that drives at a speed V goes on beside a path, and how far that is along it.

    state  (x, y, psi, s, x_r, y_r, phi)       input  u

    x' = V cos(psi)     y' = V sin(psi)     psi' = u
    x_r' = s' cos(phi)  y_r' = s' sin(phi)  phi' = k(s) s'

    MPCC      s' = V
    CA-MPCC   s' = V cos(psi - phi) / softmin(1 - k e, 0.3)        e: left of the path

1 - k e is what the path is shorter by inside a bend: there a point gets on faster than it drives.
The soft minimum keeps that finite at the bend's middle, and is 0.04 m off after 3 m at e k = 0.5.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any

from dart_hal.vehicle.namespace import ARRAY, Namespace, Value

# Of the soft minimum.
LEAST = 0.3
SHARPNESS = 10.0

State7 = tuple[Value, Value, Value, Value, Value, Value, Value]
Curve = Callable[[Value], Value]


class Law(str, Enum):
    """How progress is counted."""

    MPCC = "mpcc"
    CA = "ca-mpcc"

    def __str__(self) -> str:
        return self.value


def softmin(x: Value, f: Namespace = ARRAY) -> Value:
    """x where it is large, ``LEAST`` where it is small."""
    return LEAST + 0.5 * (1.0 + f.tanh(SHARPNESS * (x - LEAST))) * (x - LEAST)


def make_rates(law: Law, speed: Value, curve: Curve,
               f: Namespace = ARRAY) -> Callable[..., State7]:
    """``rates(x, y, psi, s, x_r, y_r, phi, u)``; speed: V [m/s], one or of each lane; curve(s):
    curvature [1/m] of the path."""

    def rates(x: Value, y: Value, psi: Value, s: Value, x_r: Value, y_r: Value, phi: Value,
              u: Value) -> State7:
        c = f.cos(phi)
        d = f.sin(phi)
        k = curve(s)
        way: Value = speed
        if law is Law.CA:
            right = (x - x_r) * d - (y - y_r) * c
            way = speed * f.cos(psi - phi) / softmin(1.0 + k * right, f)
        return speed * f.cos(psi), speed * f.sin(psi), u, way, way * c, way * d, way * k

    return rates


def make_stage(rates: Callable[..., State7], dt: float) -> Callable[..., tuple[Value, ...]]:
    """``stage(x, .., phi, u)``: the state dt [s] later by one Runge-Kutta step of fourth order."""

    def moved(z: tuple[Value, ...], h: float, by: tuple[Value, ...]) -> tuple[Value, ...]:
        return tuple(a + h * b for a, b in zip(z, by, strict=True))

    def stage(*at: Any) -> tuple[Value, ...]:
        z = at[:-1]
        u = at[-1]
        a = rates(*z, u)
        b = rates(*moved(z, 0.5 * dt, a), u)
        c = rates(*moved(z, 0.5 * dt, b), u)
        d = rates(*moved(z, dt, c), u)
        return tuple(v + dt / 6.0 * (p + 2.0 * (q + r) + w)
                     for v, p, q, r, w in zip(z, a, b, c, d, strict=True))

    return stage
