"""How far a car rolls, and the error every drive ends with when something is wrong."""

from __future__ import annotations

import math

from dart_hal.core.types import Pose
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.parameters import Vehicle

from .floor import Fence

SLIPPERY = 0.75
"""Share of the assumed friction that the rolling distance is computed with."""
BACK = 0.1
"""s until the throttle is off: command, PWM frame, ESC."""
STEP = 0.02
"""m/s between two points of the table."""


class Rolling:
    """``rolling(v)``: distance [m] in which a car that is let go comes to rest."""

    def __init__(self, vehicle: Vehicle, fastest: float = 6.0) -> None:
        friction = make_friction(vehicle.friction)
        self._table = [0.0]
        for i in range(int(fastest / STEP)):
            v = (i + 0.5) * STEP
            slowing = -SLIPPERY * friction(max(v, 0.15)) / vehicle.body.mass
            self._table.append(self._table[-1] + v * STEP / slowing)

    def __call__(self, speed: float) -> float:
        index = min(int(abs(speed) / STEP) + 1, len(self._table) - 1)
        return self._table[index] + BACK * abs(speed)


def stays_inside(fence: Fence, pose: Pose, curvature: float, distance: float) -> bool:
    """Whether a car that rolls ``distance`` [m] on its arc [1/m] ends inside the fence."""
    for share in (0.0, 0.34, 0.67, 1.0):
        d = share * distance
        half = 0.5 * curvature * d
        chord = d * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        if not fence.inside(pose.x + chord * math.cos(pose.yaw + half),
                            pose.y + chord * math.sin(pose.yaw + half)):
            return False
    return True
