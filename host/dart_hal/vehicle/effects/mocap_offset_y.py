"""Offset of the marker across the car.

    x - k sin(yaw),  y + k cos(yaw)      k > 0: to the left of the configured position
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def pose(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        return v[0] - k * f.sin(v[2]), v[1] + k * f.cos(v[2]), v[2]

    return signal


EFFECT = Effect(
    name="mocap_offset_y",
    title="carries its marker further left or right than was measured",
    signed_titles=(
        "carries its marker further right than was measured",
        "carries its marker further left than was measured"),
    physics=(
        "Such a marker is faster in a curve to the other side."),
    stage="measurement",
    acts_along=("yaw_rate",),
    parameters=(Parameter("k", "m", -0.1, 0.1, sizes=(0.003, 0.008, 0.02),
                          meaning="distance of the marker to the left of its stated position"),),
    confused_with=("mocap_offset_x", "cornering_drag"),
    experiment="Slow circles to both sides: the speed errs with opposite signs.",
    signals={"pose": Static(pose)},
)
