"""Scale of the encoder: the distance per mark differs from the configured value.

    reading = (1 + k) v
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def scale_speed(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v * (1.0 + k)

    return signal


EFFECT = Effect(
    name="encoder_scale",
    title="has an encoder that reads too much or too little",
    signed_titles=("has an encoder that reads too little", "has an encoder that reads too much"),
    physics="Wheel radius, marks and gear ratio set it. A worn tyre is 2 % smaller.",
    stage="measurement",
    acts_along=("speed",),
    parameters=(Parameter("k", "relative", -0.3, 0.3, sizes=(0.005, 0.015, 0.04),
                          meaning="excess of the encoder's speed"),),
    confused_with=("encoder_slip", "encoder_ring"),
    experiment="Roll the car along a tape by hand. Then drive it and compare.",
    signals={"wheel": Static(scale_speed)},
)
