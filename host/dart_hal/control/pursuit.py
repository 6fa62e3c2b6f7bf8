"""Pure pursuit by geometry alone: steer along the arc that meets the path a look-ahead away.

``trackers.Pursuit`` is the one to drive with: it knows the car's bends and delays.
``PurePursuit``, of version 0.1, knows its wheelbase, and takes look-ahead and delay as numbers.

R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm",
CMU-RI-TR-92-01 (1992); written for the rear axle, where ``State.pose`` is.
"""

from __future__ import annotations

from math import atan, atan2, cos, hypot, pi, remainder, sin

from dart_hal.control.paths import Path
from dart_hal.core.types import Pose

# m: a third of the tightest radius below, where the arc cuts corners by 2 cm.
LOOK_AHEAD = 0.35
# s from a command to the wheels: half a PWM frame and the servo's travel.
DELAY = 0.04


class PurePursuit:
    """Road-wheel angle that follows a path; remembers how far along it is."""

    def __init__(self, path: Path, wheelbase: float, look_ahead: float = LOOK_AHEAD,
                 delay: float = DELAY) -> None:
        self.path = path
        self.s = 0.0
        """Arc length of the closest point [m]; grows over laps."""
        self.offset = 0.0
        """Distance to the left of the path [m]."""
        self._wheelbase = wheelbase
        self._look_ahead = look_ahead
        self._delay = delay

    def steer(self, pose: Pose, speed: float, yaw_rate: float) -> float:
        """Steering angle [rad] for a pose, speed [m/s] and yaw rate [rad/s]."""
        self.s = self.path.closest(pose.x, pose.y, self.s)
        self.offset = self.path.offset(pose.x, pose.y, self.s)
        ahead = speed * self._delay
        yaw = pose.yaw + yaw_rate * self._delay
        x = pose.x + ahead * cos(pose.yaw)
        y = pose.y + ahead * sin(pose.yaw)
        tx, ty = self.path.point(self.s + ahead + self._look_ahead)
        return atan(self._wheelbase * arc(x, y, yaw, tx, ty))


def arc(x: float, y: float, course: float, tx: float, ty: float) -> float:
    """Curvature [1/m] of the arc that leaves x, y [m] along ``course`` [rad] and meets tx, ty; to a
    point behind, the tightest that such a distance has."""
    distance = max(hypot(tx - x, ty - y), 1e-3)
    bearing = remainder(atan2(ty - y, tx - x) - course, 2.0 * pi)
    return 2.0 * sin(min(max(bearing, -0.5 * pi), 0.5 * pi)) / distance
