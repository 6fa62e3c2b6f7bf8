"""Rolling resistance: a constant force against the motion.

    F_f - k tanh(b v)      F_f, b: friction of the model
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"friction": {"a": p.friction.a + k}})


EFFECT = Effect(
    name="rolling_resistance",
    title="rolls harder or more easily than the model",
    signed_titles=("rolls more easily than the model", "rolls harder than the model"),
    physics="Tyres, bearings and gears resist at any speed.",
    stage="force",
    acts_along=("speed", "throttle"),
    parameters=(Parameter("k", "N", -1.0, 5.0, sizes=(0.1, 0.25, 0.5),
                          meaning="additional rolling resistance"),),
    confused_with=(
        "quadratic_drag", "motor_gain", "motor_deadband", "road_slope_x", "road_slope_y"),
    experiment="Coasting in both directions. Drag acts only at speed; a slope changes sign.",
    vehicle=vehicle,
)
