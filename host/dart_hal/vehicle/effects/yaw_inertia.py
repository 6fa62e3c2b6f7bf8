"""Yaw inertia: the car resists changes of its yaw rate more or less than the model.

    I_z (1 + k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"body": {"yaw_inertia": p.body.yaw_inertia * (1.0 + k)}})


EFFECT = Effect(
    name="yaw_inertia",
    title="takes longer or less long to begin and end a turn than the model",
    signed_titles=(
        "begins and ends a turn faster than the model",
        "begins and ends a turn more slowly than the model"),
    physics="Published values are those of a rectangle and differ by a third.",
    stage="motion",
    acts_along=("yaw_rate", "steering_rate"),
    parameters=(Parameter("k", "relative", -0.7, 3.0, sizes=(0.3, 0.6, 1.2),
                          meaning="change of the yaw inertia"),),
    confused_with=("steering_lag", "yaw_damping", "grip", "front_grip"),
    experiment="Steering changes at high speed; a servo lag acts at any.",
    vehicle=vehicle,
)
