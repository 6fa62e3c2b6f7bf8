"""One car of a platoon: what it knows of itself and of the car ahead in, steering and speed out.

Across, a tracker of ``control.trackers`` keeps it on the path by poses in the room, or ``by_lane``
between the boards that its lidar sees. Along, the
acceleration of ``Follower`` (the first car: of ``leader``, or of who drives) is summed up to a
speed; ``Car.drive_speed`` makes the throttle of it, by the identified model, in time with a ramp.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, inf, sin

import numpy as np

from dart_hal.control.ending import PATIENCE
from dart_hal.control.follow import Command, start_of
from dart_hal.control.lap import CRAWL
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.platoon.by_lane import ByLane
from dart_hal.control.platoon.follower import Follower, Gap, Mode
from dart_hal.control.platoon.gains import Gains
from dart_hal.control.platoon.hearing import FRESH, Told
from dart_hal.control.platoon.laws import clipped
from dart_hal.control.platoon.laws import leader as holds
from dart_hal.control.platoon.spacing import heard, seen
from dart_hal.control.trackers import TRACKERS
from dart_hal.core.types import FloatArray, MotionEstimate, Scan, Tracking

# Poses: 0.5 s of States, a scan takes 0.13.
KEPT = 50
# m/s by which the speed that is asked for may lead or trail the car's: the loop catches up.
AHEAD = 0.3


@dataclass(frozen=True, slots=True)
class Ahead:
    """What the predecessor told: x, y [m] of its rear axle, speed [m/s], acceleration [m/s2], as
    they were at t [s] of the own clock."""

    t: float
    x: float
    y: float
    speed: float
    acceleration: float


class PlatoonCar:
    """One drive: ``answer`` once per State. drives (t [s], speed [m/s]): acceleration [m/s2] of a
    leader, who has no follower. tracker: of ``TRACKERS``, or "lane".

    ``u`` [m/s2]: what is asked for; ``seen``: the last gap by the lidar; ``offset`` [m] from the
    path. ``mode``, ``why``: of the follower, but STOP where the own pose is lost, or the lane.
    """

    def __init__(self, path: Path, plant: Plant, follower: Follower | None = None, *,
                 gains: Gains | None = None, tracker: str = "lqr",
                 drives: Callable[[float, float], float] | None = None, dt: float = 0.05) -> None:
        self.path = path
        self.plant = plant
        self.follower = follower
        if gains is None:
            gains = Follower().gains if follower is None else follower.gains
        self.gains = gains
        self.tracker = ByLane(path, plant) if tracker == "lane" else TRACKERS[tracker](path, plant)
        self._tables = plant.gains  # made here, not while the car drives
        self.tracker.pace = lambda s: max(self._wanted, CRAWL)
        self.u = 0.0
        self.seen: Gap | None = None
        self.mode = Mode.STOP
        self.why = "no pose came yet"
        self._drives = drives or (lambda t, speed: holds(self.gains, speed))
        self._dt = follower.dt if follower is not None else dt
        self._wanted = 0.0
        self._next = -inf
        self._located = -inf
        self._poses: deque[tuple[float, ...]] = deque(maxlen=KEPT)
        self._new: Gap | None = None

    @property
    def offset(self) -> float:
        """m to the left of the path."""
        return self.tracker.offset

    def answer(self, motion: MotionEstimate, scans: Sequence[Scan] = (),
               ahead: Ahead | None = None) -> Command:
        """What to command at ``motion.t``; scans: that came since; ahead: told last, of any age.

        Raises UsageError for a start that is too far from the path."""
        t = motion.t
        pose = motion.pose
        if motion.tracking is Tracking.TRACKING:
            if self._located == -inf:
                self.tracker.begin(start_of(self.path, pose))
                self._next = t
            self._located = t
        if self._located == -inf:
            return Command(0.0, 0.0)
        if isinstance(self.tracker, ByLane):
            self.tracker.look(scans)
        steering = self.tracker.steer(motion)
        since = t - self._poses[-1][0] if self._poses else 0.0
        self._poses.append((t, pose.x, pose.y, pose.yaw, self.tracker.s))
        for scan in scans:
            self._look(scan)
        if ahead is not None:
            self._hear(ahead, t)
        if t >= self._next - 1e-6:
            self._next += self._dt
            self.u = self._decides(t, max(motion.speed, 0.0), ahead)
        self._wanted = self._sum(since, max(motion.speed, 0.0))
        return Command(steering, self._wanted)

    def plan(self, motion: MotionEstimate, told: float | None = None) -> FloatArray:
        """Two points (2, 4) for ``Member.tell_plan`` with a step of ``dt``: of now, and where the
        acceleration leads; told [m/s2]: the one that is told in its place."""
        pose = motion.pose
        v = max(motion.speed, 0.0)
        dt = self._dt
        u = self.u if told is None else told
        end = v + u * dt if told is not None else max(v + u * dt, 0.0)
        way = 0.5 * (v + end) * dt
        return np.array(((pose.x, pose.y, pose.yaw, v),
                         (pose.x + way * cos(pose.yaw), pose.y + way * sin(pose.yaw), pose.yaw,
                          end)))

    def _look(self, scan: Scan) -> None:
        """The gap by one revolution."""
        t, x, y, yaw, s = np.array(self._poses).T
        points = scan.points(lambda at: (np.interp(at, t, x), np.interp(at, t, y),
                                         np.interp(at, t, yaw)))
        good = np.isfinite(points[:, 0]) & (scan.t >= t[0])
        at = scan.t[good]
        found = seen(points[good], at, self.path, np.interp(at, t, s))
        if found is not None:
            self.seen = self._new = found

    def _hear(self, ahead: Ahead, t: float) -> None:
        """What was told; where nothing is seen, its place as well."""
        if self.follower is None:
            return
        new = self.follower.hearing.take(Told(ahead.t, ahead.speed, ahead.acceleration), t)
        if new and t - ahead.t <= FRESH and (self.seen is None or t - self.seen.t > FRESH):
            table = np.array(self._poses)
            s = float(np.interp(ahead.t, table[:, 0], table[:, 4]))
            self._new = heard(ahead.x, ahead.y, ahead.t, self.path, s)

    def _decides(self, t: float, speed: float, ahead: Ahead | None) -> float:
        """Acceleration [m/s2] for the next step."""
        lost = "the pose is lost" if t - self._located > PATIENCE else self.tracker.why
        if self.follower is None:
            self.mode, self.why = (Mode.STOP, lost) if lost else (Mode.LEAD, "")
            return self.gains.u_min if lost else clipped(self.gains, self._drives(t, speed))
        u = self.follower.answer(t, speed, self._new)
        self._new = None
        self.mode = self.follower.mode
        self.why = self.follower.why
        if lost:
            self.mode = Mode.STOP
            self.why = lost
        return self.gains.u_min if lost else u

    def _sum(self, since: float, speed: float) -> float:
        """Speed [m/s] to ask for."""
        wanted = self._wanted + self.u * since
        wanted = min(max(wanted, speed - AHEAD, 0.0), speed + AHEAD, self.gains.v_max)
        return wanted if wanted > CRAWL or self.u > 0.0 else 0.0
