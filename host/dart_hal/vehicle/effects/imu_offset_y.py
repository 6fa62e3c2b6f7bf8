"""Offset of the IMU across the car: it is mounted to the left of the centre of mass.

    a_x - k d(omega)/dt,  a_y - k omega^2
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def accel(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        return v[0] - k * now.omega_dot, v[1] - k * now.omega * now.omega

    return signal


EFFECT = Effect(
    name="imu_offset_y",
    title="has an IMU to the left or right of its middle",
    signed_titles=("has an IMU to the right of its middle", "has an IMU to the left of its middle"),
    physics="There an accelerometer measures a side acceleration in turns.",
    stage="measurement",
    acts_along=("yaw_rate",),
    parameters=(Parameter("k", "m", -0.1, 0.1, sizes=(0.01, 0.02, 0.05),
                          meaning="distance of the IMU to the left of the middle"),),
    confused_with=("imu_roll", "imu_lever_arm"),
    experiment="Use a ruler. Or fast circles: the side acceleration has one sign.",
    signals={"accel": Static(accel)},
)
