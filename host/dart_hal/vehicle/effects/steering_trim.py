"""Steering trim: the wheels stand askew by a constant angle.

    angle = map(s) + k
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def trimmed(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v + k

    return signal


EFFECT = Effect(
    name="steering_trim",
    title="steers to one side of where the model steers",
    signed_titles=(
        "steers to the right of where the model steers",
        "steers to the left of where the model steers"),
    physics=(
        "The horn of the servo sits on a toothed shaft and the rods have threads: "
        "centre is where somebody set it, and a bump moves it."),
    stage="actuator",
    acts_along=("steering_angle",),
    parameters=(Parameter("k", "rad", -0.2, 0.2, sizes=(0.005, 0.01, 0.02),
                          meaning="road-wheel angle to the left of the model's"),),
    confused_with=("steering_backlash", "pwm_clock", "lateral_pull", "mocap_yaw", "gyro_bias"),
    experiment=(
        "Straight drives at two speeds, then circles of equal command to both sides: a "
        "trim adds the same curvature at every speed; a pull grows with the slip of the "
        "tyres, and play depends on the side from which the command came."),
    signals={"angle": Static(trimmed)},
)
