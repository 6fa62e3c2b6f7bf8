"""Other cars on the path: which are passed, and which are waited for.

Each is a disc around its centre that contains its body at any heading. If the disc leaves a passage
within the lane it becomes an obstacle of the plan. Otherwise the car drives no faster than it can
stop before it, and starts again when it has gone. A car without recent data is assumed at its last
position and is not passed. One that is lost while it is being passed stays an obstacle, so that the
car does not steer back into it. What may be a car, but is not confirmed, is not passed either.

Between its data a car drives along the path at constant speed, with a growing uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, dist, hypot, inf, sin
from typing import NamedTuple

import numpy as np

from dart_hal.control.crossing.speed import safe_speed, stopping_distance
from dart_hal.control.mpc.obstacles import (
    HALF_LENGTH,
    HALF_WIDTH,
    LATERAL_MARGIN,
    OBSTACLE_LANE_MARGIN,
    Obstacle,
    required_offset,
)
from dart_hal.control.mpc.reference import PathReference
from dart_hal.control.paths import Path
from dart_hal.core.types import Pose, TextEnum

# Radius of the disc that contains a body [m].
BODY_RADIUS = hypot(HALF_LENGTH, HALF_WIDTH)
# Additional distance to a car that is waited for, beyond that of ``safe_speed`` [m].
STOP_GAP = 0.15
# Standard errors of the pose of another car that are added to its radius.
POSE_STD_FACTOR = 2.0
# Target speeds below the first are replaced by rest; a car at rest starts above the second [m/s].
MIN_TARGET_SPEED = 0.2
MIN_START_SPEED = 0.3
# Additional width of a passage after waiting [m].
RESTART_MARGIN = 0.03
# Width [m] that may be missing in a passage that has begun: noise of the position.
KEEP_MARGIN = 0.02
# m between the expected place of a car and a new track or a possible car that are one.
SAME_CAR_DISTANCE = 0.4


class TrafficWait(TextEnum):
    """What the other cars require."""

    FREE = "FREE"
    BEHIND = "BEHIND"
    LOST = "LOST"
    UNCONFIRMED = "UNCONFIRMED"


class NearbyCar(NamedTuple):
    """Another car.

    pose: of its rear axle, in the frame of the own poses; speed [m/s]; age [s]: of both;
    lost: its last data are too old; speed_std [m/s]; along_std [m]: standard error along its path
    by its age; confirmed: otherwise it may be something else, or another car of the list.
    """

    name: str
    pose: Pose
    speed: float
    age: float
    lost: bool
    speed_std: float = 0.0
    along_std: float = 0.0
    confirmed: bool = True


class PathTraffic:
    """Call ``judge`` with each State. ``obstacles``: to be passed; ``speed`` [m/s]: limit, 0: wait;
    ``wait``, ``who``: the reason and the car; ``seconds``: duration of each kind of wait.
    """

    def __init__(self, path: Path, lane: float, rear: float, passes: bool) -> None:
        """lane [m]: to either side; rear [m]: from a rear axle to the centre of the body; passes:
        whether the tracker passes obstacles.
        """
        self._path = path
        self._reference = PathReference(path)
        self._lane = lane
        self._rear = rear
        self._passes = passes
        self.obstacles: tuple[Obstacle, ...] = ()
        self.speed = inf
        self.room = inf
        self.wait = TrafficWait.FREE
        self.who = ""
        self.seconds = dict.fromkeys(TrafficWait, 0.0)
        self._t = inf
        self._passed: frozenset[str] = frozenset()

    def judge(self, t: float, s: float, speed: float, others: Iterable[NearbyCar]) -> None:
        """Update at t [s], with the rear axle at arc length s [m] and a speed [m/s].

        1. Locate each car on the path ahead. A possible car at the place of another one is that
           car.
        2. Pass it if the tracker can, its data are recent and the passage is wide enough.
        3. Otherwise keep the speed from which the car still stops before it. If it is being
           passed already, it remains an obstacle as well.
        """
        self.seconds[self.wait] += max(t - self._t, 0.0)
        self._t = t
        last_who = self.who
        sight = stopping_distance(max(speed, 1.0)) + 2.0 * self._rear + 1.0
        passing = []
        passed: set[str] = set()
        room = inf
        wait = TrafficWait.FREE
        who = ""
        for other in self._drop_known(list(others)):
            obstacle = self._locate(other, t, s, sight)
            if obstacle is None:
                continue
            passage = (
                self._lane
                - OBSTACLE_LANE_MARGIN
                - required_offset(obstacle)
                - (RESTART_MARGIN if other.name == last_who else 0.0)
            )
            was_passed = self._passes and other.name in self._passed
            least = -KEEP_MARGIN if was_passed else 0.0
            is_free = (self._passes and other.confirmed and not other.lost
                       and passage >= least)
            if is_free or (was_passed and passage > -OBSTACLE_LANE_MARGIN):
                passing.append(obstacle)
                passed.add(other.name)
            if is_free:
                continue
            distance = (obstacle.s - s - self._rear - obstacle.radius - HALF_LENGTH - STOP_GAP
                        - POSE_STD_FACTOR * other.along_std)
            if distance < room:
                room = distance
                wait = (TrafficWait.UNCONFIRMED if not other.confirmed else
                        TrafficWait.LOST if other.lost else TrafficWait.BEHIND)
                who = other.name
        self._passed = frozenset(passed)
        self.obstacles = tuple(passing)
        self.room = room
        self.wait = wait
        self.who = who
        allowed = float(safe_speed(room)) if room < inf else inf
        self.speed = (
            0.0
            if allowed < (MIN_START_SPEED if self.speed == 0.0 else MIN_TARGET_SPEED)
            else allowed
        )

    def _drop_known(self, cars: list[NearbyCar]) -> list[NearbyCar]:
        """Return the cars without the possible ones at the expected place of another car."""
        places = []
        for car in cars:
            if car.confirmed:
                x, y = self._centre(car.pose)
                travel = 0.0 if car.lost else car.speed * car.age
                places.append((x + travel * cos(car.pose.yaw), y + travel * sin(car.pose.yaw)))
        return [car for car in cars if car.confirmed or all(
            dist(self._centre(car.pose), place) > SAME_CAR_DISTANCE for place in places)]

    def _centre(self, pose: Pose) -> tuple[float, float]:
        """Return the centre of a body [m]."""
        return pose.x + self._rear * cos(pose.yaw), pose.y + self._rear * sin(pose.yaw)

    def _locate(self, other: NearbyCar, t: float, s: float, sight: float) -> Obstacle | None:
        """Return a car as an obstacle on the path ahead, or None."""
        pose = other.pose
        x, y = self._centre(pose)
        radius = BODY_RADIUS + POSE_STD_FACTOR * float(np.sqrt(max(pose.cov[0, 0], pose.cov[1, 1])))
        if not self._path.closed:
            sight = min(sight, max(self._path.length - s, 0.0) + 1.0)
        s_ahead = np.arange(s, s + sight, 0.05)
        x_r, y_r, headings = self._reference.poses(s_ahead)
        k = int(np.argmin(np.hypot(x_r - x, y_r - y)))
        dx = x - float(x_r[k])
        dy = y - float(y_r[k])
        heading = float(headings[k])
        along = cos(heading) * dx + sin(heading) * dy
        offset = cos(heading) * dy - sin(heading) * dx
        speed = 0.0 if other.lost else other.speed * cos(pose.yaw - heading)
        travel = speed * other.age
        is_behind = k == 0 and along + travel < -self._rear
        is_beyond = k == len(s_ahead) - 1 and along > 0.1
        if is_behind or is_beyond or abs(offset) > radius + HALF_WIDTH + LATERAL_MARGIN:
            return None
        return Obstacle(float(s_ahead[k]) + along + travel, offset, radius, speed, t,
                        POSE_STD_FACTOR * other.speed_std)
