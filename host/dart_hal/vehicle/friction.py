"""Rolling friction and drag of the whole drive train.

    F(v) = -((a + brake) tanh(b v) + (c + q |v|) v)

a: dry friction with a smooth sign of the speed, c: viscous friction, q: quadratic drag. a, b and c
are those of the DART paper; q and brake are additions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Friction


def make_friction(p: Friction, xp: Any = math) -> Callable[..., Value]:
    """Return ``friction(v, brake=0) -> F`` [N], odd in v [m/s].

    ``brake`` [N] is added to the dry friction a and changes sign with v in the same way.
    """
    f = adapt(xp)
    a = p.a
    b = p.b
    c = p.c
    q = p.q
    tanh = f.tanh
    fabs = f.fabs

    def friction(v: Value, brake: Value = 0.0) -> Value:
        return -((a + brake) * tanh(b * v) + (c + q * fabs(v)) * v)

    return friction
