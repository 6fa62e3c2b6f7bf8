"""Track of the straight tests: a lane, or two lanes joined by turns to an oval."""

from __future__ import annotations

import math

from dart_hal.control.paths import Path
from dart_hal.control.pursuit import arc
from dart_hal.core.types import Pose

from .floor import FLOOR_MARGIN, Floor, StartPlace

# [m] Radius of the turns: cars of this class turn within 0.5 to 0.65 m.
TURN_RADIUS = 0.75
LOOK_AHEAD = 0.40
# [s] At 2 m/s the car aims 1.1 m ahead, which is five steering delays.
TRACK_LOOK_AHEAD_TIME = 0.35
# [s] From a command to the wheels, for cars whose delay is not identified yet.
ASSUMED_DELAY = 0.1


class DriveTrack:
    """A lane, or an oval: lanes at y = 0 and 2 TURN_RADIUS, left half circles at both ends.

    straight [m]: length of a lane. The car starts at the beginning of the lane, heading along it.
    """

    def __init__(self, straight: float, *, oval: bool) -> None:
        self.straight = straight
        self.oval = oval
        turn = (math.pi * TURN_RADIUS, 1.0 / TURN_RADIUS)
        pieces = [(straight, 0.0), turn] * 2 if oval else [(straight, 0.0)]
        self.path = Path(pieces, closed=oval)
        self.s = 0.0
        """Arc length reached [m], grows over laps."""

    @property
    def half(self) -> float:
        """Distance [m] from the start of a lane to the start of the next."""
        return self.straight + math.pi * TURN_RADIUS if self.oval else self.straight

    def update(self, pose: Pose) -> None:
        """Update the progress from the car's pose; call at every frame.

        A car that starts slightly before the lane is at its beginning, and not at the end of the
        turn that closes the oval: s is never negative.
        """
        self.s = max(self.path.closest(pose.x, pose.y, self.s), 0.0)

    @property
    def remaining(self) -> float:
        """Remaining lane ahead [m]; 0 on a turn."""
        return max(self.straight - self.s % self.half, 0.0) if self.oval else max(
            self.straight - self.s, 0.0)

    def along_path(self, pose: Pose, speed: float, wheelbase: float) -> float:
        """Compute the road-wheel angle [rad] to follow lanes and turns (pure pursuit)."""
        # The pose is predicted over the delay, and the target is ahead of the predicted pose.
        reach = LOOK_AHEAD + TRACK_LOOK_AHEAD_TIME * 0.5 * speed
        tx, ty = self.path.point(self.s + ASSUMED_DELAY * speed + reach)
        x = pose.x + ASSUMED_DELAY * speed * math.cos(pose.yaw)
        y = pose.y + ASSUMED_DELAY * speed * math.sin(pose.yaw)
        return math.atan(wheelbase * arc(x, y, pose.yaw, tx, ty))

    def along_lane(self, pose: Pose, speed: float, wheelbase: float) -> float:
        """Compute the road-wheel angle [rad] to follow the lane, extended beyond its end."""
        back = self.oval and math.cos(pose.yaw) < 0.0
        left = (2.0 * TURN_RADIUS - pose.y) if back else pose.y
        heading = math.remainder(pose.yaw - (math.pi if back else 0.0), 2.0 * math.pi)
        reach = LOOK_AHEAD + TRACK_LOOK_AHEAD_TIME * speed
        bearing = math.atan2(-left, reach) - heading
        return math.atan2(2.0 * wheelbase * math.sin(bearing), math.hypot(reach, left))

    def nearest(self, pose: Pose, *, lane: bool) -> Pose:
        """Return the closest pose of the lane (extended beyond its end), or of the path."""
        if lane:
            back = self.oval and math.cos(pose.yaw) < 0.0
            return Pose(pose.x, 2.0 * TURN_RADIUS if back else 0.0, math.pi if back else 0.0)
        return Pose(*self.path.interpolate(self.s)[:3])


def longest_lane(floor: Floor, *, oval: bool) -> float:
    """Return the longest lane [m] on this floor; not positive if none fits."""
    if oval and floor.width < oval_width():
        return 0.0
    return floor.length - 2.0 * FLOOR_MARGIN - (2.0 * TURN_RADIUS if oval else 0.0)


def oval_width() -> float:
    """Return the width of floor [m] that two lanes and a turn need."""
    return 2.0 * TURN_RADIUS + 2.0 * FLOOR_MARGIN


def start_place(*, oval: bool) -> StartPlace:
    """Return the start of the car before the first lane."""
    return StartPlace(FLOOR_MARGIN + (TURN_RADIUS if oval else 0.0), FLOOR_MARGIN)
