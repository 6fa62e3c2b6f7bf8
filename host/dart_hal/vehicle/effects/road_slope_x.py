"""Slope of the floor along x of the room.

    acceleration k = g slope along x of the room      k > 0: downhill towards +x

An accelerometer measures the acceleration without that of gravity, so it reads k less along x.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Forces, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    # The pull has a fixed direction in the room; the heading turns it into body axes.
    weight = p.body.mass * k

    def hook(q: Forces) -> Forces:
        return q._replace(f_x=q.f_x + weight * f.cos(q.eta),
                          f_y=q.f_y - weight * f.sin(q.eta))

    return hook


def accel(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        return v[0] - k * f.cos(now.yaw), v[1] + k * f.sin(now.yaw)

    return signal


EFFECT = Effect(
    name="road_slope_x",
    title="is pulled along x of the room by a slope",
    physics=(
        "One centimetre per metre is 0.1 m/s2, a tenth of the friction."),
    stage="force",
    acts_along=("heading", "x"),
    parameters=(Parameter("k", "m/s2", -1.0, 1.0, sizes=(0.05, 0.1, 0.2),
                          meaning="downhill acceleration along x of the room"),),
    confused_with=("road_slope_y", "rolling_resistance", "lateral_pull", "imu_pitch", "imu_roll"),
    experiment="One straight drive in four directions: the error changes with the heading.",
    force=force,
    signals={"accel": Static(accel)},
)
