"""Bias of the gyro.

    reading = omega + k
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def add_bias(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v + k

    return signal


EFFECT = Effect(
    name="gyro_bias",
    title="has a gyro that reads a turn at standstill",
    signed_titles=(
        "has a gyro that reads a right turn at standstill",
        "has a gyro that reads a left turn at standstill"),
    physics="The zero of a micromechanical gyro drifts with temperature.",
    stage="measurement",
    acts_along=("yaw_rate", "time"),
    parameters=(Parameter("k", "rad/s", -0.3, 0.3, sizes=(0.005, 0.02, 0.05),
                          meaning="yaw rate that the gyro reads at standstill"),),
    confused_with=("steering_trim", "gyro_scale", "lateral_pull"),
    experiment=(
        "Keep the car at rest for ten seconds: the mean reading is the bias."),
    signals={"gyro": Static(add_bias)},
)
