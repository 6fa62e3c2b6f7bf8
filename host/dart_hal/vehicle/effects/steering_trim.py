"""Steering trim: the road-wheel angle has a constant offset.

    angle = map(s) + k
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def add_trim(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v + k

    return signal


EFFECT = Effect(
    name="steering_trim",
    title="has a steering offset to one side of the model",
    signed_titles=(
        "steers further to the right than the model",
        "steers further to the left than the model"),
    physics="Assembly sets the centre, and an impact moves it.",
    stage="actuator",
    acts_along=("steering_angle",),
    parameters=(Parameter("k", "rad", -0.2, 0.2, sizes=(0.005, 0.01, 0.02),
                          meaning="road-wheel angle to the left of the model's"),),
    confused_with=("steering_backlash", "pwm_clock", "lateral_pull", "mocap_yaw", "gyro_bias"),
    experiment=(
        "Straight drives at two speeds. A trim adds one curvature; a pull grows with tyre slip."),
    signals={"angle": Static(add_trim)},
)
