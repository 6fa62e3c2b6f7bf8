"""Driving in the middle of a lane by the lidar alone: which steering and speed to command.

    WAITING ---> FOLLOWING ---> STOPPING ---> ENDED
     no lane      in it          slows down    at rest

Each scan shows the lane anew (``lane``); between two the model knows where the car is in it
(``lane_model``). Steering is pure pursuit (``pursuit.arc``) to a point a look-ahead away from where
the car will be when the answer acts. It is never faster than it can stop within what it sees.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, sqrt

import numpy as np

from dart_hal.control.ending import PATIENCE, WAIT, Ending, Phase
from dart_hal.control.follow import Command, Driven
from dart_hal.control.lane import Sight, look
from dart_hal.control.lane_model import Reckoning
from dart_hal.control.lap import CRAWL, GRIP
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.pursuit import arc
from dart_hal.control.stopping import ROLLS, SLOWS, STUCK
from dart_hal.core.types import FloatArray, Pose, Scan

# m and s of the look-ahead: 0.3 m at 1 m/s, 0.5 at 2. At 0.5 m the play of the linkage, 1 to 2
# deg, swings the car by 1.5 cm at 1 m/s, at 0.3 m by 0.8; at 2 m/s a scan is 0.5 m old.
NEAR = 0.1
PER_SPEED = 0.2
# m of the car before the rear axle, and some.
FRONT = 0.3
# What the points (m, 2) [m] of a scan show, from the car's pose among them on.
Look = Callable[[FloatArray, Pose], Sight]
# m over which the bend ahead is taken: noise of 1 cm is a bend of 8 m.
BENDS = 0.6


class LaneFollower(Ending):
    """One drive. ``answer`` once per State, with the scans since, until ``phase`` is ENDED; ``why``
    then tells the end, ``good`` whether it was one that was asked for.

    ``cap`` [m/s] may be set at any time; distance [m] and duration [s] from where it begins end it.
    ``path``: the lane ahead as it was seen last, in the frame of ``model``; ``half`` [m] its half
    width; ``driven`` holds rows as those of ``Follower``, its x, y in that frame.
    """

    ends = "the lane ends"
    """Why it ended where nothing of it is left."""

    def __init__(self, plant: Plant, cap: float, distance: float = inf,
                 duration: float = inf, look: Look = look) -> None:
        super().__init__()
        self.plant = plant
        self.cap = cap
        self.distance = distance
        self.duration = duration
        self.model = Reckoning(plant)
        self._most = plant.steady.fastest  # its tables are made here, not while the car drives
        self.path: Path | None = None
        self.half = self.s = self.offset = 0.0
        self.driven = Driven()
        self.seen: list[tuple[float, float, float, float]] = []
        """x, y [m], heading [rad] of the lane beside the car and its half width [m], each scan."""
        self._look = look
        self._sight: Sight | None = None
        self._begun = self._whole = self._scanned = -inf

    def answer(self, t: float, speed: float, scans: Sequence[Scan] = ()) -> Command:
        """What to command at t [s], with the speed [m/s] of the wheels and what came of scans."""
        if self._begun == -inf:
            self._begun = self._whole = self._scanned = self._before = t
        now = self.model.go(t, speed)
        for scan in scans:
            self._see(scan)
        if self.phase is Phase.WAITING:
            if self.path is None:
                if t - self._begun > WAIT:
                    self._end(f"{self._fault()} within {WAIT:g} s", Phase.ENDED)
                return Command(0.0, 0.0)
            self.phase = Phase.FOLLOWING
            self._begun = t
        if self.phase is Phase.ENDED or self.path is None:
            return Command(0.0, 0.0)
        self.s = self.path.closest(now.pose.x, now.pose.y, self.s)
        self.offset = self.path.offset(now.pose.x, now.pose.y, self.s)
        self._judge(t)
        wanted = self._wanted(speed)
        self.driven.rows.append((t, now.pose.x, now.pose.y, self.offset, speed, wanted,
                                 self.model.way))
        self._before = t
        return Command(self._steer(self.path), wanted)

    @property
    def fastest(self) -> float:
        """m/s that may be asked for anywhere."""
        return self.cap

    def told(self) -> str:
        """What it sees, in words."""
        ahead = self.path.length if self.path else 0.0
        return f"a lane {200.0 * self.half:.0f} cm wide, seen {ahead:.1f} m ahead"

    def _see(self, scan: Scan) -> None:
        """The lane that a scan shows."""
        self._scanned = self.model.now.t
        self._sight = sight = self._look(self.model.points(scan), self.model.now.pose)
        if not sight.whole or len(sight.middle) < 3:
            return
        path = Path.through(sight.middle, closed=False)
        if self.path is not None:
            self._learn(self.path, path)
        self.path = path
        self.half = sight.half
        self.s = 0.0
        self._whole = self.model.now.t
        self.seen.append((*sight.middle[0].tolist(), float(path.heading[0]), sight.half))

    def _learn(self, before: Path, after: Path) -> None:
        """What one lane, seen twice, tells of the car."""
        self.model.compare(before, after)

    def _steer(self, path: Path) -> float:
        """Angle [rad] of the road wheels to command."""
        late = self.plant.late
        low, high = self.plant.lock
        where = self.model.at(self.model.now.t + late.transport + late.settles + late.lag)
        reach = NEAR + PER_SPEED * abs(where.speed)
        target = path.at(path.closest(where.x, where.y, self.s) + reach)
        bend = arc(where.x, where.y, where.course(self.plant), target.x, target.y)
        angle = self.plant.steady.turn(bend, where.speed).angle - self.model.trim
        angle = min(max(angle, low), high)
        self.model.sent(angle)
        return angle

    def _judge(self, t: float) -> None:
        """Ends what has to end."""
        if self.phase is Phase.STOPPING:
            return
        if t - self._whole > PATIENCE:
            self._end(f"{self._fault()} for {t - self._whole:.1f} s")
        elif self._standing.stuck(t, self.model.now.speed):
            self._end(f"the car does not move, though asked to for {STUCK:g} s")
        elif t - self._begun > self.duration:
            self._end(f"the time of {self.duration:g} s is over", good=True)
        elif self.model.way > self.distance:
            self._end(f"{self.distance:g} m are driven", good=True)

    def _fault(self) -> str:
        """Why there is no lane."""
        sight = self._sight
        if sight is None or self.model.now.t - self._scanned > 0.5 * PATIENCE:
            return "the lidar is silent"
        if sight.left or sight.right:
            return f"only the {'left' if sight.left else 'right'} board is seen"
        return "no boards are seen"

    def _wanted(self, speed: float) -> float:
        """Speed to ask for [m/s]."""
        if self.phase is Phase.STOPPING:
            return self._stops(self.model.now)
        assert self.path is not None
        left = max(self.path.length - self.s - FRONT, 0.0)
        if left <= speed**2 / (2.0 * ROLLS) and speed < 2.0 * CRAWL:
            self._end(self.ends, good=True)
            return 0.0
        self._speed = max(min(self.cap, self._holds(self.path), sqrt(2.0 * SLOWS * left)), CRAWL)
        return self._speed

    def _holds(self, path: Path) -> float:
        """Speed [m/s] that the bends ahead hold."""
        n = max(round(BENDS / path.spacing), 1)
        bends: FloatArray = (path.heading[n:] - path.heading[:-n]) / BENDS
        return GRIP * float(np.min(self._most(bends, self.plant.lock), initial=inf))


class WallFollower(LaneFollower):
    """Along a wall instead, by ``look=Wall(...)``. Nothing is learnt of the car: a new way is
    planned from where it is with every scan."""

    ends = "the way is blocked"

    def told(self) -> str:
        return f"a way of {self.path.length if self.path else 0.0:.1f} m is clear"

    def _learn(self, before: Path, after: Path) -> None:
        pass

    def _fault(self) -> str:
        silent = self._sight is None or self.model.now.t - self._scanned > 0.5 * PATIENCE
        return "the lidar is silent" if silent else self.ends
