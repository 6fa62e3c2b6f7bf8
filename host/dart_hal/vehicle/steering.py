"""Steering map of the DART paper: command s, -1..1 (+1 full left), to road-wheel angle delta.

    c     = s + s0
    w     = (tanh(30 c) + 1) / 2                                   1: left, 0: right
    delta = w a_left tanh(k_left c) + (1 - w) a_right tanh(k_right c)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from dart_hal.core.errors import NotMonotone
from dart_hal.vehicle.namespace import Value, adapt

if TYPE_CHECKING:
    from dart_hal.vehicle.parameters import Steering

# Steepness of the transition between the left and the right curve; it is 2 / 30 = 0.07 wide in s.
BLEND = 30.0
# Largest gain of a side that counts as a straight line: tanh(k) is 8 % below k. Below it amplitude
# and gain are known by their product alone, and an amplitude may be at its largest allowed value.
MAX_STRAIGHT_GAIN = 0.5
# The gain of the side that an amplitude belongs to.
GAIN_OF_AMPLITUDE = {"a_left_rad": "k_left", "a_right_rad": "k_right"}


def make_steering(p: Steering, xp: Any = math) -> Callable[[Value], Value]:
    """Return ``steering(s) -> delta`` [rad].

    Gains multiply the command and amplitudes the tanh. The table of the paper has two of the five
    numbers under swapped names.
    """
    tanh = adapt(xp).tanh
    k_left = p.k_left
    a_left = p.a_left_rad
    s0 = p.s0
    a_right = p.a_right_rad
    k_right = p.k_right

    def steering(s: Value) -> Value:
        c = s + s0
        # Weight of the left curve. Both curves are 0 at c = 0, so the transition adds no step.
        left = 0.5 * (tanh(BLEND * c) + 1.0)
        return left * a_left * tanh(k_left * c) + (1.0 - left) * a_right * tanh(k_right * c)

    return steering


def is_straight(name: str, parameters: Mapping[str, float]) -> bool:
    """Return whether ``name`` is the amplitude of a side whose map is a straight line.

    parameters: of the map by name.

    >>> is_straight("a_left_rad", {"a_left_rad": 1.4, "k_left": 0.3})
    True
    >>> is_straight("k_left", {"a_left_rad": 1.4, "k_left": 0.3})
    False
    """
    gain = GAIN_OF_AMPLITUDE.get(name)
    return gain is not None and parameters[gain] <= MAX_STRAIGHT_GAIN


def check_monotone(p: Steering, n: int = 401) -> None:
    """Raise NotMonotone unless the map increases over all of [-1, 1]."""
    curve = make_steering(p)
    angles = [curve(-1.0 + 2.0 * i / (n - 1)) for i in range(n)]
    falls = [i for i in range(1, n) if angles[i] <= angles[i - 1]]
    if falls:
        s = -1.0 + 2.0 * falls[0] / (n - 1)
        raise NotMonotone(f"the steering map falls at command {s:+.3f}", found=repr(p))


def make_steering_inverse(p: Steering) -> Callable[[float], float]:
    """Return ``command(delta) -> s`` for floats; angles beyond the stops give -1 or +1.

    42 bisections of [-1, 1]: exact to 2 / 2^42 < 1e-12, without a start value.
    Raises NotMonotone when the map cannot be inverted.
    """
    check_monotone(p)
    curve = make_steering(p)
    lowest = curve(-1.0)
    highest = curve(1.0)

    def command(delta: float) -> float:
        if delta <= lowest or delta >= highest:
            return -1.0 if delta <= lowest else 1.0
        low = -1.0
        high = 1.0
        for _ in range(42):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if curve(middle) < delta else (low, middle)
        return 0.5 * (low + high)

    return command
