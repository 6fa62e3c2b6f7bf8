"""Steering gain: all angles of the map are larger or smaller by the same factor.

    angle = (1 + k) map(s)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"steering": {"a_left_rad": p.steering.a_left_rad * (1.0 + k),
                                  "a_right_rad": p.steering.a_right_rad * (1.0 + k)}})


EFFECT = Effect(
    name="steering_gain",
    title="turns its wheels further or less far than the model",
    signed_titles=(
        "turns its wheels less far than the model",
        "turns its wheels further than the model"),
    physics="Servo horn and steering arms set this ratio.",
    stage="actuator",
    acts_along=("steering_angle",),
    parameters=(Parameter("k", "relative", -0.5, 0.5, sizes=(0.02, 0.05, 0.10),
                          meaning="change of the road-wheel angle"),),
    confused_with=("front_grip", "grip", "steering_compliance", "gyro_scale"),
    experiment="Slow circles show the angle alone; grip acts in fast ones.",
    vehicle=vehicle,
)
