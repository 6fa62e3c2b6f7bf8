"""Scale of the gyro.

    reading = (1 + k) omega
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def scale_rate(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v * (1.0 + k)

    return signal


EFFECT = Effect(
    name="gyro_scale",
    title="has a gyro that reads turns too large or too small",
    signed_titles=(
        "has a gyro that reads turns too small",
        "has a gyro that reads turns too large"),
    physics="A micromechanical gyro is trimmed to a few percent.",
    stage="measurement",
    acts_along=("yaw_rate",),
    parameters=(Parameter("k", "relative", -0.3, 0.3, sizes=(0.01, 0.03, 0.06),
                          meaning="excess of the gyro's yaw rate"),),
    confused_with=("steering_gain", "gyro_bias", "imu_pitch", "imu_roll"),
    experiment="Ten turns to each side by hand. A bias has one sign on both sides.",
    signals={"gyro": Static(scale_rate)},
)
