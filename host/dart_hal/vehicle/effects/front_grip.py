"""Front grip: the side force of the front axle is larger or smaller by a factor.

    (1 + k) F_yf
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"tyres": {"front_D": p.tyres.front_D * (1.0 + k)}})


EFFECT = Effect(
    name="front_grip",
    title="has more or less grip at its front wheels than the model",
    signed_titles=(
        "has less grip at its front wheels than the model",
        "has more grip at its front wheels than the model"),
    physics="Front tyres wear faster, and a load changes one axle.",
    stage="force",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "relative", -0.6, 0.6, sizes=(0.05, 0.1, 0.2),
                          meaning="change of the side force of the front tyres"),),
    confused_with=("grip", "steering_compliance", "steering_gain", "load_transfer"),
    experiment=(
        "Circles of one command at rising speed: the radius changes, the rear slip does not."),
    vehicle=vehicle,
)
