"""Yaw of the marker: its axes are rotated against those of the car.

    yaw + k
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def pose(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        return v[0], v[1], v[2] + k

    return signal


EFFECT = Effect(
    name="mocap_yaw",
    title="carries its marker turned about the vertical",
    signed_titles=(
        "carries its marker turned to the right",
        "carries its marker turned to the left"),
    physics="The axes of a marker are those at its registration.",
    stage="measurement",
    acts_along=("speed",),
    parameters=(Parameter("k", "rad", -0.2, 0.2, sizes=(0.005, 0.01, 0.03),
                          meaning="rotation of the marker to the left"),),
    confused_with=("steering_trim", "lateral_pull"),
    experiment="Drive forwards and in reverse: the side velocity changes sign.",
    signals={"pose": Static(pose)},
)
