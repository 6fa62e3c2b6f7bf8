"""Quadratic drag: a force against the motion that grows with the square of the speed.

    F_f - k v |v|      F_f: friction of the model
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"friction": {"q": p.friction.q + k}})


EFFECT = Effect(
    name="quadratic_drag",
    title="is slowed down at speed more than the model",
    physics=(
        "Air, and any resistance that grows faster than the speed."),
    stage="force",
    acts_along=("speed",),
    parameters=(Parameter("k", "N s2/m2", 0.0, 2.0, sizes=(0.03, 0.08, 0.2),
                          meaning="drag per squared speed"),),
    confused_with=("rolling_resistance", "motor_gain", "cornering_drag", "battery_fade"),
    experiment="Coasting from the highest speed: the loss over speed shows the exponent.",
    vehicle=vehicle,
)
