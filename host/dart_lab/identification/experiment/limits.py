"""Distance in which a car rolls to a stop, and whether it stays inside the fence."""

from __future__ import annotations

import math

from dart_hal.core.types import Pose
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.parameters import Vehicle

from .floor import Fence

# The rolling distance is computed with this share of the model's friction.
FRICTION_SHARE = 0.75
# [s] Until the throttle is off: command, PWM frame, ESC.
RELEASE_TIME = 0.1
# [m/s] Between two points of the table.
SPEED_STEP = 0.02


class RollingDistance:
    """Distance [m] ``rolling(v)`` in which a car without throttle comes to rest from v [m/s]."""

    def __init__(self, vehicle: Vehicle, fastest: float = 6.0) -> None:
        friction = make_friction(vehicle.friction)
        # dx = v dv / a(v), summed from standstill up.
        self._table = [0.0]
        for i in range(int(fastest / SPEED_STEP)):
            v = (i + 0.5) * SPEED_STEP
            slowing = -FRICTION_SHARE * friction(max(v, 0.15)) / vehicle.body.mass
            self._table.append(self._table[-1] + v * SPEED_STEP / slowing)

    def __call__(self, speed: float) -> float:
        index = min(int(abs(speed) / SPEED_STEP) + 1, len(self._table) - 1)
        return self._table[index] + RELEASE_TIME * abs(speed)


def stays_inside(fence: Fence, pose: Pose, curvature: float, distance: float) -> bool:
    """Return whether a car that rolls ``distance`` [m] on its arc [1/m] stays in the fence."""
    # The chord of an arc of length d is sin(k d / 2) / (k / 2), at half of its turn.
    for share in (0.0, 0.34, 0.67, 1.0):
        d = share * distance
        half = 0.5 * curvature * d
        chord = d * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        if not fence.inside(pose.x + chord * math.cos(pose.yaw + half),
                            pose.y + chord * math.sin(pose.yaw + half)):
            return False
    return True
