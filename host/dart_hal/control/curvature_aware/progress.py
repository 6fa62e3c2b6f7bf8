"""Motion of a point with speed V near a path, and its progress along the path.

    state  (x, y, psi, s, x_r, y_r, phi)       input  u

    x' = V cos(psi)     y' = V sin(psi)     psi' = u
    x_r' = s' cos(phi)  y_r' = s' sin(phi)  phi' = k(s) s'

    MPCC      s' = V
    CA-MPCC   s' = V cos(psi - phi) / softmin(1 - k e, 0.3)        e: left of the path

1 - k e is the ratio of lengths inside a bend: there the progress is faster than the point. The soft
minimum keeps it finite at the centre of the bend, and is 0.04 m off after 3 m at e k = 0.5.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.core.types import TextEnum
from dart_hal.vehicle.namespace import ARRAY, Namespace, Value

# Parameters of the soft minimum.
SOFTMIN_FLOOR = 0.3
SOFTMIN_SHARPNESS = 10.0

State7 = tuple[Value, Value, Value, Value, Value, Value, Value]
CurvatureFunction = Callable[[Value], Value]


class Law(TextEnum):
    """Law of the progress."""

    MPCC = "mpcc"
    CA = "ca-mpcc"


def softmin(x: Value, f: Namespace = ARRAY) -> Value:
    """Return x where it is large, ``SOFTMIN_FLOOR`` where it is small."""
    return SOFTMIN_FLOOR + 0.5 * (1.0 + f.tanh(SOFTMIN_SHARPNESS * (x - SOFTMIN_FLOOR))) * (
        x - SOFTMIN_FLOOR
    )


def make_rates(law: Law, speed: Value, curve: CurvatureFunction,
               f: Namespace = ARRAY) -> Callable[..., State7]:
    """Return ``rates(x, y, psi, s, x_r, y_r, phi, u)``.

    speed: V [m/s], one or one for each batch element; curve(s): curvature [1/m] of the path.
    """

    def rates(x: Value, y: Value, psi: Value, s: Value, x_r: Value, y_r: Value, phi: Value,
              u: Value) -> State7:
        cos_phi = f.cos(phi)
        sin_phi = f.sin(phi)
        k = curve(s)
        progress_rate: Value = speed
        if law is Law.CA:
            e_right = (x - x_r) * sin_phi - (y - y_r) * cos_phi
            progress_rate = speed * f.cos(psi - phi) / softmin(1.0 + k * e_right, f)
        return (
            speed * f.cos(psi),
            speed * f.sin(psi),
            u,
            progress_rate,
            progress_rate * cos_phi,
            progress_rate * sin_phi,
            progress_rate * k,
        )

    return rates


def make_stage(rates: Callable[..., State7], dt: float) -> Callable[..., tuple[Value, ...]]:
    """Return ``stage(x, .., phi, u)``: the state dt [s] later by one RK4 step."""

    def add_scaled(z: tuple[Value, ...], h: float, rates: tuple[Value, ...]) -> tuple[Value, ...]:
        return tuple(a + h * b for a, b in zip(z, rates, strict=True))

    def stage(*at: Any) -> tuple[Value, ...]:
        z = at[:-1]
        u = at[-1]
        a = rates(*z, u)
        b = rates(*add_scaled(z, 0.5 * dt, a), u)
        c = rates(*add_scaled(z, 0.5 * dt, b), u)
        d = rates(*add_scaled(z, dt, c), u)
        return tuple(v + dt / 6.0 * (p + 2.0 * (q + r) + w)
                     for v, p, q, r, w in zip(z, a, b, c, d, strict=True))

    return stage
