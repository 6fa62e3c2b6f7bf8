"""Pure pursuit by geometry: steer along the arc that meets the path at a look-ahead distance.

``trackers.Pursuit`` is the tracker for driving: it uses the car's cornering and delays.
``PurePursuit``, of version 0.1, uses the wheelbase, and its look-ahead and delay are parameters.

R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm",
CMU-RI-TR-92-01 (1992); written for the rear axle, where ``State.pose`` is.
"""

from __future__ import annotations

from math import atan, atan2, cos, hypot, pi, remainder, sin

from dart_hal.control.paths import Path
from dart_hal.core.types import Pose

# Look-ahead distance [m]: a third of the tightest radius at which the arc cuts corners by 2 cm.
DEFAULT_LOOK_AHEAD = 0.35
# Time from a command to the wheels [s]: half a PWM frame and the travel of the servo.
DEFAULT_DELAY = 0.04


class PurePursuit:
    """Road-wheel angle that follows a path; stores its arc length."""

    def __init__(self, path: Path, wheelbase: float, look_ahead: float = DEFAULT_LOOK_AHEAD,
                 delay: float = DEFAULT_DELAY) -> None:
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
        travel = speed * self._delay
        yaw = pose.yaw + yaw_rate * self._delay
        x = pose.x + travel * cos(pose.yaw)
        y = pose.y + travel * sin(pose.yaw)
        tx, ty = self.path.point(self.s + travel + self._look_ahead)
        return atan(self._wheelbase * arc(x, y, yaw, tx, ty))


def arc(x: float, y: float, course: float, tx: float, ty: float) -> float:
    """Return the curvature [1/m] of the arc from x, y [m] in direction ``course`` [rad] to tx, ty.

    For a point behind, the tightest arc of that distance: k = 2 sin(bearing) / distance.
    """
    distance = max(hypot(tx - x, ty - y), 1e-3)
    bearing = remainder(atan2(ty - y, tx - x) - course, 2.0 * pi)
    return 2.0 * sin(min(max(bearing, -0.5 * pi), 0.5 * pi)) / distance
