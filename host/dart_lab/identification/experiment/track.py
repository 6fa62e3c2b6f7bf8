"""Where straight tests are driven: a lane, or two lanes joined by turns to an oval."""

from __future__ import annotations

import math

from dart_hal.control.paths import Path
from dart_hal.control.pursuit import arc
from dart_hal.core.types import Pose

from .floor import MARGIN, Floor, Place

TURN = 0.75
"""m, radius of the turns: cars of this class turn within 0.5 to 0.65 m."""
LOOK_AHEAD = 0.40
LOOK_AHEAD_TIME = 0.35
"""m, and s of travel: at 2 m/s the car aims 1.1 m ahead, five steering delays away."""
DELAY = 0.1
"""s from a command to the wheels, for cars whose delay nobody knows yet."""


class Track:
    """``oval``: lanes at y = 0 and 2 TURN, left half circles at both ends; else one lane.

    ``straight`` [m] is the length of a lane. The car starts at the beginning of
    the lane, looking along it.
    """

    def __init__(self, straight: float, *, oval: bool) -> None:
        self.straight, self.oval = straight, oval
        turn = (math.pi * TURN, 1.0 / TURN)
        pieces = [(straight, 0.0), turn] * 2 if oval else [(straight, 0.0)]
        self.path = Path(pieces, closed=oval)
        self.s = 0.0
        """Arc length reached [m], grows over laps."""

    @property
    def half(self) -> float:
        """From the start of a lane to the start of the next [m]."""
        return self.straight + math.pi * TURN if self.oval else self.straight

    def seen(self, pose: Pose) -> None:
        """The car is here; call at every frame.

        Nobody drives backwards: a car set down a hair before the lane stands at its beginning, not
        at the end of the turn that closes the oval.
        """
        self.s = max(self.path.closest(pose.x, pose.y, self.s), 0.0)

    @property
    def remaining(self) -> float:
        """Lane ahead [m]; 0 on a turn."""
        return max(self.straight - self.s % self.half, 0.0) if self.oval else max(
            self.straight - self.s, 0.0)

    def along_path(self, pose: Pose, speed: float, wheelbase: float) -> float:
        """Road-wheel angle [rad] that follows lanes and turns (pure pursuit)."""
        reach = LOOK_AHEAD + LOOK_AHEAD_TIME * 0.5 * speed
        tx, ty = self.path.point(self.s + DELAY * speed + reach)
        x = pose.x + DELAY * speed * math.cos(pose.yaw)
        y = pose.y + DELAY * speed * math.sin(pose.yaw)
        return math.atan(wheelbase * arc(x, y, pose.yaw, tx, ty))

    def along_lane(self, pose: Pose, speed: float, wheelbase: float) -> float:
        """Road-wheel angle [rad] that keeps the lane as if it had no end."""
        back = self.oval and math.cos(pose.yaw) < 0.0
        left = (2.0 * TURN - pose.y) if back else pose.y
        heading = math.remainder(pose.yaw - (math.pi if back else 0.0), 2.0 * math.pi)
        reach = LOOK_AHEAD + LOOK_AHEAD_TIME * speed
        bearing = math.atan2(-left, reach) - heading
        return math.atan2(2.0 * wheelbase * math.sin(bearing), math.hypot(reach, left))

    def nearest(self, pose: Pose, *, lane: bool) -> Pose:
        """The point beside the car: of the lane as if it had no end, or of the path."""
        if lane:
            back = self.oval and math.cos(pose.yaw) < 0.0
            return Pose(pose.x, 2.0 * TURN if back else 0.0, math.pi if back else 0.0)
        return Pose(*self.path.at(self.s)[:3])


def straight_of(floor: Floor, *, oval: bool) -> float:
    """Longest lane [m] on this floor; not positive if there is no room at all."""
    if oval and floor.width < oval_width():
        return 0.0
    return floor.length - 2.0 * MARGIN - (2.0 * TURN if oval else 0.0)


def oval_width() -> float:
    """Floor across [m] that two lanes and a turn need."""
    return 2.0 * TURN + 2.0 * MARGIN


def start_of(*, oval: bool) -> Place:
    """Where the car stands before the first lane."""
    return Place(MARGIN + (TURN if oval else 0.0), MARGIN)
