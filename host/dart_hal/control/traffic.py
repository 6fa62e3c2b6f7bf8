"""Other cars on the path: which are passed, and before which to stand.

Each is a disc about its middle that holds its body however it is turned. Where it leaves a way
within the lane it is an obstacle of the plan; otherwise the car drives no faster than it can stop
before it, and starts again when it has gone. One that was not heard for a while stands, as far as
anybody knows, where it was: it is not passed.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from math import cos, hypot, inf, sin
from typing import NamedTuple

import numpy as np

from dart_hal.control.crossing.speed import safe_speed, stopping_distance
from dart_hal.control.mpc.obstacles import HALF_LENGTH, HALF_WIDTH, MARGIN, Obstacle, needed
from dart_hal.control.mpc.reference import Reference
from dart_hal.control.mpc.tracker import EDGE
from dart_hal.control.paths import Path
from dart_hal.core.types import Pose

RADIUS = hypot(HALF_LENGTH, HALF_WIDTH)
# m of air to one before which the car stands, beside what ``safe_speed`` keeps.
GAP = 0.15
# Standard errors of another's place that are added to its radius.
SURE = 2.0
# m/s: less is asked for as rest; a car at rest starts for more.
STANDS = 0.2
STARTS = 0.3
# m of the lane that have to be left, once it waits, before it passes after all.
BACK = 0.03


class Wait(str, Enum):
    """What the others ask of the car."""

    FREE = "FREE"
    BEHIND = "BEHIND"
    LOST = "LOST"

    def __str__(self) -> str:
        return self.value


class Neighbour(NamedTuple):
    """Another car: pose of its rear axle in the frame of the own poses, speed [m/s], age [s] of
    both; lost: it was not heard for too long."""

    name: str
    pose: Pose
    speed: float
    age: float
    lost: bool


class Traffic:
    """``judge`` with each answer. ``obstacles``: to be passed; ``speed`` [m/s]: no faster, 0: it
    stands; ``wait``, ``who``: for what, and for whom; ``seconds``: of each wait."""

    def __init__(self, path: Path, lane: float, rear: float, passes: bool) -> None:
        """lane [m] to either side; rear [m]: from a rear axle to the middle; passes: whether the
        tracker can."""
        self._path = path
        self._reference = Reference(path)
        self._lane = lane
        self._rear = rear
        self._passes = passes
        self.obstacles: tuple[Obstacle, ...] = ()
        self.speed = inf
        self.room = inf
        self.wait = Wait.FREE
        self.who = ""
        self.seconds = dict.fromkeys(Wait, 0.0)
        self._t = inf

    def judge(self, t: float, s: float, speed: float, others: Iterable[Neighbour]) -> None:
        """At t [s], the rear axle at arc length s [m], at a speed [m/s]."""
        self.seconds[self.wait] += max(t - self._t, 0.0)
        self._t = t
        before = self.who
        sight = stopping_distance(max(speed, 1.0)) + 2.0 * self._rear + 1.0
        passing = []
        room = inf
        wait = Wait.FREE
        who = ""
        for other in others:
            met = self._met(other, t, s, sight)
            if met is None:
                continue
            way = self._lane - EDGE - needed(met) - (BACK if other.name == before else 0.0)
            if self._passes and not other.lost and way >= 0.0:
                passing.append(met)
                continue
            free = met.s - s - self._rear - met.radius - HALF_LENGTH - GAP
            if free < room:
                room = free
                wait = Wait.LOST if other.lost else Wait.BEHIND
                who = other.name
        self.obstacles = tuple(passing)
        self.room = room
        self.wait = wait
        self.who = who
        allowed = float(safe_speed(room)) if room < inf else inf
        self.speed = 0.0 if allowed < (STARTS if self.speed == 0.0 else STANDS) else allowed

    def _met(self, other: Neighbour, t: float, s: float, sight: float) -> Obstacle | None:
        """It beside the way ahead; None: it is not there."""
        pose = other.pose
        moved = 0.0 if other.lost else other.speed * other.age
        x, y = (at + (self._rear + moved) * part for at, part in (
            (pose.x, cos(pose.yaw)), (pose.y, sin(pose.yaw))))
        radius = RADIUS + SURE * float(np.sqrt(max(pose.cov[0, 0], pose.cov[1, 1])))
        if not self._path.closed:
            sight = min(sight, max(self._path.length - s, 0.0) + 1.0)
        way = np.arange(s, s + sight, 0.05)
        x_r, y_r, headings = self._reference.spots(way)
        near = int(np.argmin(np.hypot(x_r - x, y_r - y)))
        dx = x - float(x_r[near])
        dy = y - float(y_r[near])
        heading = float(headings[near])
        along = cos(heading) * dx + sin(heading) * dy
        offset = cos(heading) * dy - sin(heading) * dx
        behind = near == 0 and along < -self._rear
        beyond = near == len(way) - 1 and along > 0.1
        if behind or beyond or abs(offset) > radius + HALF_WIDTH + MARGIN:
            return None
        pace = 0.0 if other.lost else other.speed * cos(pose.yaw - heading)
        return Obstacle(float(way[near]) + along, offset, radius, pace, t)
