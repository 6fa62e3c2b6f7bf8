"""Yaw of the IMU: its axes are rotated against those of the car.

    a_x cos k + a_y sin k,  a_y cos k - a_x sin k      k > 0: to the left
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def accel(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        c = f.cos(k)
        s = f.sin(k)
        return v[0] * c + v[1] * s, v[1] * c - v[0] * s

    return signal


EFFECT = Effect(
    name="imu_yaw",
    title="has an IMU that is turned about the vertical",
    signed_titles=(
        "has an IMU that is turned to the right",
        "has an IMU that is turned to the left"),
    physics="A misaligned board mixes forward and side acceleration.",
    stage="measurement",
    acts_along=("acceleration", "lateral_acceleration"),
    parameters=(Parameter("k", "rad", -0.5, 0.5, sizes=(0.02, 0.05, 0.1),
                          meaning="rotation of the IMU to the left"),),
    confused_with=("imu_lever_arm",),
    experiment="Accelerate and brake: side acceleration follows the forward one.",
    signals={"accel": Static(accel)},
)
