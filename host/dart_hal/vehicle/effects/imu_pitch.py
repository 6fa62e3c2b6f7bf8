"""Pitch of the IMU: it is mounted nose down by an angle.

    a_x cos k - g sin k      a part of gravity is in the reading
    omega cos k
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import GRAVITY, Vehicle


def accel(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        return v[0] * f.cos(k) - GRAVITY * f.sin(k), v[1]

    return signal


def gyro(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v * f.cos(k)

    return signal


EFFECT = Effect(
    name="imu_pitch",
    title="has an IMU that is tilted forwards or backwards",
    signed_titles=("has an IMU that is tilted backwards", "has an IMU that is tilted forwards"),
    physics="One degree of tilt adds 0.17 m/s2 of gravity.",
    stage="measurement",
    acts_along=("speed",),
    parameters=(Parameter("k", "rad", -0.5, 0.5, sizes=(0.01, 0.02, 0.05),
                          meaning="tilt of the IMU, nose down"),),
    confused_with=("road_slope_x", "road_slope_y", "imu_roll"),
    experiment=(
        "At rest in two opposite headings: a tilted IMU reads the same, a slope the opposite."),
    signals={"accel": Static(accel), "gyro": Static(gyro)},
)
