"""Following a path from a start near it to a safe end: which steering and speed to command, and
why it ended.

    WAITING ----> JOINING ----> FOLLOWING ----> STOPPING ----> ENDED
     no pose      off the lane  in the lane     slows down     at rest

Anything that ends the drive goes through STOPPING: the car slows down along the path. One that does
not come to rest in time is given up at neutral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import hypot, inf, sqrt
from typing import NamedTuple

import numpy as np

from dart_hal.control.ending import BRIDGED, PATIENCE, WAIT, Ending, Phase
from dart_hal.control.lap import CRAWL, SpeedProfile, speed_profile
from dart_hal.control.on_path import Tracker
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.stopping import RESTS, ROLLS, SLOWS, STUCK
from dart_hal.control.trackers import TRACKERS
from dart_hal.core.errors import UsageError
from dart_hal.core.types import START, FloatArray, MotionEstimate, Pose, Tracking

# m from the path and, by 90 deg, along it: where a drive may begin.
START_WITHIN = 1.0
# m to either side that the car may be off, once it was within.
LANE = 0.3
# m; a room that has not seen the car move yet does not know where its marker sits.
STARTS = 0.1
# m of way to come into the lane: from 1 m beside it at 35 deg to the path 2 m, and a turn.
JOIN = 6.0
# m/s; [limits] max_speed of a car that has none of its own.
MOST = 5.0


class Command(NamedTuple):
    """steering [rad], speed [m/s]."""

    steering: float
    speed: float


@dataclass(frozen=True, slots=True)
class Rules:
    """laps: of a closed path (an open one ends by itself); duration [s] from its first motion on;
    lane [m] to either side;
    odometry: dead reckoning will do; here: the path is begun where the car stands."""

    laps: float = 1.0
    duration: float = inf
    lane: float = LANE
    odometry: bool = False
    here: bool = False


@dataclass
class Driven:
    """What was driven: t, x, y, offset, speed, wanted speed, arc length at each answer; times of
    the laps [s], the first from its first motion on."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    lap_times: list[float] = field(default_factory=list)

    @property
    def table(self) -> FloatArray:
        """The rows, (n, 7)."""
        return np.array(self.rows).reshape(-1, 7)


class Follower(Ending):
    """One drive. ``answer`` once per State, until ``phase`` is ENDED; ``why`` then tells the end,
    ``good`` whether it was the one that was asked for.

    ``cap`` [m/s] may be set at any time, and ``free``, what others leave of it; 0: it stands where
    it is until that changes.
    ``begun_at`` [m]: where on the path the car was.
    """

    def __init__(self, path: Path, plant: Plant, cap: float = inf,
                 tracker: str | Callable[[Path, Plant], Tracker] = "lqr",
                 rules: Rules | None = None, most: float = MOST) -> None:
        """tracker: one of ``TRACKERS``, or what makes one; most [m/s]: of the profile, whatever the
        cap. Raises UsageError as ``speed_profile``, and for laps of an open path."""
        super().__init__()
        self.rules = rules or Rules()
        if self.rules.laps > 1.0 and not path.closed:
            raise UsageError("the path is not closed, so it has no laps",
                             found=f"its ends are {_gap(path):.2f} m apart", expected="--laps 1",
                             remedy="repeat the first row of the file as its last")
        self.plant = plant
        self._make = TRACKERS[tracker] if isinstance(tracker, str) else tracker
        self.cap = cap
        self.free = inf
        self.clock: Callable[[], float] = lambda: 0.0
        """s that go on while the tracker thinks, as ``car.now``; may be set before the start."""
        self.silent: Callable[[], bool] = lambda: False
        """Whether poses are missing for no other reason than that the lidar is silent; then wheels
        and gyro will do for ``BRIDGED`` s, while three standard errors are within the lane."""
        self.path = path
        self.profile = speed_profile(path, plant, most)
        self.tracker = self._make(path, plant)
        self.begun_at = 0.0
        self.joined = 0
        """Rows of ``driven`` before it was in the lane and under way."""
        self.driven = Driven()
        self._t0: float | None = None
        self._moves = False
        self._seen = self._lap_t = self._joining = 0.0

    def answer(self, motion: MotionEstimate) -> Command:
        """What to command at ``motion.t``. Raises UsageError for a start that is too far away."""
        t = motion.t
        if self._t0 is None:
            self._t0 = self._seen = t
        if self.phase is Phase.WAITING:
            if not self._known(motion):
                if t - self._t0 > WAIT:
                    self._end(f"no pose came within {WAIT:g} s", Phase.ENDED)
                return Command(0.0, 0.0)
            self._begin(motion)
        if self.phase is Phase.ENDED:
            return Command(0.0, 0.0)
        if not self._moves and motion.speed > RESTS:
            self._moves = True
            self._t0 = t
            self._lap_t = t
        if motion.tracking is Tracking.TRACKING or self.rules.odometry:
            self._seen = t
        steering = self.tracker.steer(motion)
        self._judge(motion)
        speed = self._wanted(motion)
        pose = motion.pose
        self.driven.rows.append((t, pose.x, pose.y, self.tracker.offset, motion.speed, speed,
                                 self.tracker.s))
        self._before = t
        return Command(steering, speed)

    @property
    def expected(self) -> float:
        """s that a flying lap (an open path, from rest to rest) takes by the profile and the cap
        of now."""
        return self.profile.capped(self.cap).time

    @property
    def fastest(self) -> float:
        """m/s that may be asked for anywhere."""
        return min(self.cap, float(self.profile.speed.max()))

    @property
    def remaining(self) -> float:
        """m to the end."""
        length = self.path.length
        end = self.begun_at + self.rules.laps * length if self.path.closed else length
        return end - self.tracker.s

    def _known(self, motion: MotionEstimate) -> bool:
        return self.rules.odometry or (motion.frame != START
                                       and motion.tracking is Tracking.TRACKING)

    def _begin(self, motion: MotionEstimate) -> None:
        """The one search of the whole path."""
        pose = motion.pose
        if self.rules.here:
            self.path = self.path.moved(pose.x, pose.y, pose.yaw)
            self.profile = SpeedProfile(self.path, self.profile.speed)
            self.tracker = self._make(self.path, self.plant)
        self.begun_at = start_of(self.path, pose)
        self.tracker.pace = self._pace
        self.tracker.clock = self.clock
        self.tracker.begin(self.begun_at)
        self.phase = Phase.JOINING
        self._lap_t = motion.t
        self._before = motion.t

    def _judge(self, motion: MotionEstimate) -> None:
        """Ends what has to end."""
        t = motion.t
        rules = self.rules
        offset = abs(self.tracker.offset)
        self._count_laps(t)
        self._joining += abs(motion.speed) * (t - self._before)
        if self.phase is Phase.JOINING and offset < 0.7 * rules.lane:
            self.phase = Phase.FOLLOWING
        if self.phase is Phase.JOINING or self.tracker.s < self.begun_at + STARTS:
            self.joined = len(self.driven.rows)
        if self.phase is Phase.STOPPING:
            return
        if t - self._seen > (BRIDGED if self._bridges(motion) else PATIENCE):
            self._end(f"the pose was lost: {motion.tracking} for {t - self._seen:.1f} s")
        elif self.phase is Phase.FOLLOWING and offset > rules.lane:
            self._end(f"the car left the lane: {offset:.2f} m off the path at "
                      f"{self.tracker.s % self.path.length:.2f} m")
        elif self.phase is Phase.JOINING and self._joining > JOIN:
            self._end(f"the car did not come into the lane within {JOIN:g} m")
        elif self.tracker.why:
            self._end(self.tracker.why)
        elif self._standing.stuck(t, motion.speed if min(self.cap, self.free) > 0.0 else inf):
            self._end(f"the car does not move, though asked to for {STUCK:g} s")
        elif self._t0 is not None and t - self._t0 > rules.duration:
            self._end(f"the time of {rules.duration:g} s is over", good=True)
        elif self.remaining <= 0.0:
            self._end("the path is driven", good=True)

    def _bridges(self, motion: MotionEstimate) -> bool:
        place = max(float(motion.cov[0, 0]), float(motion.cov[1, 1]))
        return self.silent() and 3.0 * sqrt(place) < self.rules.lane

    def _count_laps(self, t: float) -> None:
        laps = len(self.driven.lap_times) + 1
        if self.path.closed and self.tracker.s >= self.begun_at + laps * self.path.length:
            self.driven.lap_times.append(t - self._lap_t)
            self._lap_t = t

    def _pace(self, s: float) -> float:
        """Speed [m/s] that is wanted at an arc length [m]."""
        if self.phase is Phase.STOPPING:
            return self._speed
        return max(min(self.profile.at(s), self.cap, self.free), CRAWL)

    def _wanted(self, motion: MotionEstimate) -> float:
        """Speed to ask for [m/s]."""
        if self.phase is Phase.STOPPING:
            return self._stops(motion)
        self._speed = min(self._pace(self.tracker.s), max(self.tracker.speed, CRAWL))
        if min(self.cap, self.free) <= 0.0:
            self._speed = 0.0
        if not self.path.closed:
            left = max(self.remaining, 0.0)
            if left <= motion.speed**2 / (2.0 * ROLLS) and motion.speed < 2.0 * CRAWL:
                self._end("the path is driven", good=True)
                return 0.0
            self._speed = min(self._speed, max(sqrt(2.0 * SLOWS * left), CRAWL))
        return self._speed


def start_of(path: Path, pose: Pose) -> float:
    """Arc length [m] of the closest point that leads the way the car looks, of the whole path.

    Raises UsageError where it is further than ``START_WITHIN``, or leads another way.
    """
    away = np.hypot(path.x - pose.x, path.y - pose.y)
    along = np.cos(path.heading - pose.yaw) > 0.0
    k = int(np.argmin(np.where(along, away, inf)))
    if along.any() and away[k] <= START_WITHIN:
        return path.closest(pose.x, pose.y, float(path.s[k]))
    nearest = int(np.argmin(away))
    where = f"the car is at x {pose.x:.2f} y {pose.y:.2f} m, {pose.yaw:.2f} rad"
    if away[nearest] <= START_WITHIN:
        raise UsageError("the car looks against the path", found=where,
                         expected=f"a heading within 90 deg of {path.heading[nearest]:.2f} rad, "
                                  "the path's there",
                         remedy="turn the car round, or lay the path from the car with --here")
    raise UsageError(
        f"the car is {away[nearest]:.2f} m away from the path", found=where,
        expected=f"within {START_WITHIN:g} m; the path is nearest at x {path.x[nearest]:.2f} "
                 f"y {path.y[nearest]:.2f} m",
        remedy="carry the car there, or lay the path from the car with --here")


def _gap(path: Path) -> float:
    end = path.at(path.length)
    return hypot(end.x - float(path.x[0]), end.y - float(path.y[0]))
