"""Steering map of the paper: command -1..1 (+1 full left) to road-wheel angle."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.core.errors import NotMonotone
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Steering

BLEND = 30.0
"""Steepness of the change between the left and the right curve (0.07 wide in s)."""


def make_steering(p: Steering, xp: Any = math) -> Callable[[Value], Value]:
    """``steering(s) -> delta`` [rad].

    Gains multiply the command and amplitudes the tanh; the paper prints two of
    its five numbers under each other's name.
    """
    tanh = adapt(xp).tanh
    k_left, a_left, s0 = p.k_left, p.a_left_rad, p.s0
    a_right, k_right = p.a_right_rad, p.k_right

    def steering(s: Value) -> Value:
        c = s + s0
        left = 0.5 * (tanh(BLEND * c) + 1.0)
        return left * a_left * tanh(k_left * c) + (1.0 - left) * a_right * tanh(k_right * c)

    return steering


def check_monotone(p: Steering, n: int = 401) -> None:
    """Raise NotMonotone unless the map increases over all of [-1, 1]."""
    curve = make_steering(p)
    angles = [curve(-1.0 + 2.0 * i / (n - 1)) for i in range(n)]
    falls = [i for i in range(1, n) if angles[i] <= angles[i - 1]]
    if falls:
        s = -1.0 + 2.0 * falls[0] / (n - 1)
        raise NotMonotone(f"the steering map falls at command {s:+.3f}", found=repr(p))


def make_steering_inverse(p: Steering) -> Callable[[float], float]:
    """``command(delta) -> s`` for floats; angles beyond the stops give -1 or +1.

    Bisection on the monotone map: exact to 1e-12 and free of a start value.
    Raises NotMonotone when the map cannot be inverted.
    """
    check_monotone(p)
    curve = make_steering(p)
    lowest, highest = curve(-1.0), curve(1.0)

    def command(delta: float) -> float:
        if delta <= lowest or delta >= highest:
            return -1.0 if delta <= lowest else 1.0
        low, high = -1.0, 1.0
        for _ in range(42):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if curve(middle) < delta else (low, middle)
        return 0.5 * (low + high)

    return command
