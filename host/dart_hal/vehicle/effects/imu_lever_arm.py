"""Lever arm of the IMU: it is mounted ahead of the centre of mass.

    a_x - k omega^2,  a_y + k d(omega)/dt
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def accel(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        # A point k ahead on a rigid body: centripetal acceleration backwards, k omega' to the side.
        return v[0] - k * now.omega * now.omega, v[1] + k * now.omega_dot

    return signal


EFFECT = Effect(
    name="imu_lever_arm",
    title="has an IMU away from its centre of mass",
    signed_titles=(
        "has an IMU behind its centre of mass",
        "has an IMU ahead of its centre of mass"),
    physics="There an accelerometer also measures the rotation.",
    stage="measurement",
    acts_along=("yaw_rate",),
    parameters=(Parameter("k", "m", -0.2, 0.2, sizes=(0.02, 0.05, 0.1),
                          meaning="distance of the IMU ahead of the centre of mass"),),
    confused_with=("imu_yaw", "imu_pitch", "centre_of_mass"),
    experiment="Use a ruler. Or fast circles: the forward acceleration has one sign on both sides.",
    signals={"accel": Static(accel)},
)
