"""Offset of the marker along the car.

    x + k cos(yaw),  y + k sin(yaw)      k > 0: ahead of the configured position
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def pose(p: Vehicle, f: Namespace, k: Value) -> Callable[[Any, Now], Any]:
    def signal(v: Any, now: Now) -> Any:
        return v[0] + k * f.cos(v[2]), v[1] + k * f.sin(v[2]), v[2]

    return signal


EFFECT = Effect(
    name="mocap_offset_x",
    title="carries its marker further ahead or back than was measured",
    signed_titles=(
        "carries its marker further back than was measured",
        "carries its marker further ahead than was measured"),
    physics="The place of the marker is measured by ruler.",
    stage="measurement",
    acts_along=("yaw_rate",),
    parameters=(Parameter("k", "m", -0.1, 0.1, sizes=(0.003, 0.008, 0.02),
                          meaning="distance of the marker ahead of its stated position"),),
    confused_with=("centre_of_mass", "mocap_offset_y"),
    experiment="Turn the car on the spot by hand and measure the circle.",
    signals={"pose": Static(pose)},
)
