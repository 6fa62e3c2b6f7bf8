"""Steering dead zone: the wheels stay straight until the linkage has left its centre.

    delta - clip(delta, -k/2, k/2)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def angle(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    half = 0.5 * k

    def signal(v: Any, now: Now) -> Any:
        return v - f.fmax(-half, f.fmin(half, v))

    return signal


EFFECT = Effect(
    name="steering_dead_zone",
    title="does not steer for small commands about straight ahead",
    physics="Trailing wheels roll to the middle of the linkage's play.",
    stage="actuator",
    acts_along=("steering_angle",),
    parameters=(Parameter("k", "rad", 0.0, 0.3, sizes=(0.02, 0.05, 0.10),
                          meaning="range of angles without steering from end to end"),),
    confused_with=("steering_backlash", "steering_gain", "steering_compliance"),
    experiment="Small commands from both sides. With backlash the car keeps its angle.",
    signals={"angle": Static(angle)},
)
