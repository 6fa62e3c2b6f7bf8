"""Rolling friction and drag of the whole drive train."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Friction


def make_friction(p: Friction, xp: Any = math) -> Callable[..., Value]:
    """``friction(v, brake=0) -> F`` [N], odd in v [m/s], against the motion.

    ``brake`` [N] adds to the dry friction a: both change sign with v alike.
    """
    f = adapt(xp)
    a, b, c, q = p.a, p.b, p.c, p.q
    tanh, fabs = f.tanh, f.fabs

    def friction(v: Value, brake: Value = 0.0) -> Value:
        return -((a + brake) * tanh(b * v) + (c + q * fabs(v)) * v)

    return friction
