"""Following a path from a start near it to a safe end: steering, speed, and the reason of the end.

    WAITING ----> JOINING ----> FOLLOWING ----> STOPPING ----> ENDED
     no pose      off the lane  in the lane     slows down     at rest

Every end of a drive passes through STOPPING: the car slows down along the path. If it does not come
to rest in time, the stop is given up at neutral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, inf, remainder, sin, sqrt, tan, tau
from typing import NamedTuple

import numpy as np

from dart_hal.control.drive_record import DriveRecord
from dart_hal.control.ending import (
    MAX_BRIDGED_GAP,
    MAX_POSE_GAP,
    MAX_START_WAIT,
    Ending,
    Phase,
    is_located,
)
from dart_hal.control.lap import CRAWL_SPEED, SpeedProfile, speed_profile
from dart_hal.control.on_path import Tracker
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.speed_ramp import SpeedRamp
from dart_hal.control.stopping import REST_SPEED, ROLL_DECELERATION, STOP_DECELERATION, STUCK_TIME
from dart_hal.control.trackers import TRACKERS
from dart_hal.core.errors import UsageError
from dart_hal.core.numbers import is_number
from dart_hal.core.types import MotionEstimate, Pose, Tracking

# Largest distance from the path at which a drive may begin [m].
MAX_START_DISTANCE = 1.0
# Largest offset to either side, once the car is in the lane [m].
DEFAULT_HALF_WIDTH = 0.3
# Distance of the start [m]: before the car has moved, external poses do not include the position of
# its marker.
START_DISTANCE = 0.1
# Distance in which the car has to reach the lane [m]: from 1 m off the path at 35 deg to it 2 m,
# and a turn.
MAX_JOIN_DISTANCE = 6.0
# A car is in the lane once its offset, now and after it has turned along the path, is below this
# share of the lane. The rest is for the errors of tracker and model.
SHARE_OF_LANE = 0.7
# The car stops if the standard error of its position is a larger share of the lane: 1 in 7 is then
# outside of it.
MAX_STD_SHARE = 2.0 / 3.0
# Speed limit of a car without [limits] max_speed [m/s].
DEFAULT_MAX_SPEED = 5.0


class DriveCommand(NamedTuple):
    """steering [rad], speed [m/s]."""

    steering: float
    speed: float


@dataclass(frozen=True, slots=True)
class Rules:
    """Rules of a drive.

    laps: of a closed path (an open one ends by itself); duration [s]: from its first motion on;
    lane [m]: to either side; odometry: dead reckoning is accepted; here: the path begins at the
    car; careful: bends begin slowly, see ``SpeedRamp``. Raises UsageError for laps, a duration
    or a lane that are not above 0.
    """

    laps: float = 1.0
    duration: float = inf
    lane: float = DEFAULT_HALF_WIDTH
    odometry: bool = False
    here: bool = False
    careful: bool = False

    def __post_init__(self) -> None:
        for name, unit in (("laps", ""), ("duration", " s"), ("lane", " m")):
            number = getattr(self, name)
            if not is_number(number) or number <= 0.0:
                raise UsageError(f"{name} of the rules is not above 0", found=repr(number),
                                 expected=f"a number{' of' + unit if unit else ''}, above 0")


class Follower(Ending):
    """One drive. Call ``answer`` once per State until ``phase`` is ENDED; ``why`` is then the
    reason of the end, ``good`` whether it was intended.

    ``cap`` [m/s] may be set at any time, and ``free``, the limit by other cars; 0: the car waits
    until it changes. ``begun_at`` [m]: arc length at which the drive began.
    """

    def __init__(self, path: Path, plant: Plant, cap: float = inf,
                 tracker: str | Callable[[Path, Plant], Tracker] = "lqr",
                 rules: Rules | None = None, most: float = DEFAULT_MAX_SPEED) -> None:
        """tracker: one of ``TRACKERS``, or a function that makes one; most [m/s]: limit of the
        profile, in addition to the cap. Raises UsageError as ``speed_profile``, for laps of an
        open path, and for a path shorter than the wheelbase.
        """
        super().__init__()
        self.rules = rules or Rules()
        if self.rules.laps > 1.0 and not path.closed:
            raise UsageError(
                "the path is not closed, so it has no laps",
                found=f"{_end_distance(path):.2f} m between its ends",
                expected="--laps 1",
                remedy="repeat the first row of the file as its last",
            )
        wheelbase = plant.vehicle.body.wheelbase
        if path.length < wheelbase:
            raise UsageError("the path is shorter than the car", found=f"{path.length:.3f} m",
                             expected=f"more than its wheelbase of {wheelbase:.3f} m",
                             likely="its coordinates are not in m")
        self.plant = plant
        if isinstance(tracker, str) and tracker not in TRACKERS:
            raise UsageError("no such tracker", found=repr(tracker), expected=", ".join(TRACKERS),
                             remedy='Follower(..., tracker="lqr")')
        self._make = TRACKERS[tracker] if isinstance(tracker, str) else tracker
        self.cap = cap
        self.clock: Callable[[], float] = lambda: 0.0
        """Time [s] that runs while the tracker computes, as ``car.now``; may be set before."""
        self.silent: Callable[[], bool] = lambda: False
        """Whether poses are missing only because their source is silent. Then wheels and gyro
        suffice for ``MAX_BRIDGED_GAP`` s, while three standard errors of the pose are within the
        lane."""
        self.missing_reason: Callable[[], str] = lambda: ""
        """Why there is no pose yet, with the remedy; empty if that is not known."""
        self.obstructed = False
        """Whether throttle is withheld before an obstacle; set before ``answer``."""
        self.doubts = ""
        """Doubts of the speed for which throttle is withheld, by name; set before ``answer``."""
        self.path = path
        self.profile = speed_profile(path, plant, most)
        self.tracker = self._make(path, plant)
        self.begun_at = 0.0
        self.driven = DriveRecord()
        self.ramp = SpeedRamp() if self.rules.careful else None
        self._t0: float | None = None
        self._has_moved = False
        self._located_t = self._certain_t = self._lap_t = self._join_distance = 0.0

    def answer(self, motion: MotionEstimate) -> DriveCommand:
        """Return the command at ``motion.t``.

        Raises UsageError for a start that is too far away, or that points too far off the path.
        """
        t = motion.t
        if self._t0 is None:
            self._t0 = self._located_t = self._certain_t = t
        if self.phase is Phase.WAITING:
            if not self._is_located(motion):
                if t - self._t0 > MAX_START_WAIT:
                    reason = self.missing_reason()
                    self._end(f"no pose came within {MAX_START_WAIT:g} s"
                              + (f": {reason}" if reason else ""), Phase.ENDED)
                return DriveCommand(0.0, 0.0)
            self._begin(motion)
        if self.phase is Phase.ENDED:
            return DriveCommand(0.0, 0.0)
        if not self._has_moved and motion.speed > REST_SPEED:
            self._has_moved = True
            self._t0 = t
            self._lap_t = t
        if motion.tracking is Tracking.TRACKING or self.rules.odometry:
            self._located_t = t
        steering = self.tracker.steer(motion)
        self._check_end(motion)
        if self.ramp and self.phase is Phase.FOLLOWING:
            s = self.tracker.s
            limit = max(self.profile.speed_at(s), CRAWL_SPEED)
            self.ramp.update(t, s, motion.speed / limit, self.tracker.offset / self.rules.lane,
                             self.tracker.angle_error)
        speed = self._target_speed(motion)
        pose = motion.pose
        self.driven.add(t, pose.x, pose.y, self.tracker.offset, motion.speed, speed,
                        self.tracker.s)
        self._last_t = t
        return DriveCommand(steering, speed)

    @property
    def expected(self) -> float:
        """Time of a flying lap (open path: from rest to rest) by the profile and the present cap
        [s].
        """
        return self.profile.limit_to(self.cap).time

    @property
    def fastest(self) -> float:
        """Largest speed that may be commanded [m/s]."""
        return min(self.cap, float(self.profile.speed.max()))

    @property
    def remaining(self) -> float:
        """Distance to the end [m]."""
        length = self.path.length
        end = self.begun_at + self.rules.laps * length if self.path.closed else length
        return end - self.tracker.s

    def _is_located(self, motion: MotionEstimate) -> bool:
        return self.rules.odometry or is_located(motion)

    def _begin(self, motion: MotionEstimate) -> None:
        """Find the start on the whole path and initialise the tracker."""
        pose = motion.pose
        if self.rules.here:
            self.path = self.path.moved(pose.x, pose.y, pose.yaw)
            self.profile = SpeedProfile(self.path, self.profile.speed)
            self.tracker = self._make(self.path, self.plant)
        self.begun_at = find_start(self.path, pose)
        self._check_turn(pose)
        wheelbase = self.plant.vehicle.body.wheelbase
        rest = self.path.length - self.begun_at
        if not self.path.closed and rest < wheelbase:
            raise UsageError(
                "the car is at the end of the path", found=f"{rest:.2f} m are left",
                expected=f"more than its wheelbase of {wheelbase:.3f} m",
                remedy="move the car to the start of the path, or start the path at the car with "
                       "--here")
        self.tracker.pace = self._pace_at
        self.tracker.clock = self.clock
        self.tracker.begin(self.begun_at)
        self.phase = Phase.JOINING
        self._lap_t = motion.t
        self._last_t = motion.t

    def _check_end(self, motion: MotionEstimate) -> None:
        """End the drive if a condition requires it."""
        t = motion.t
        rules = self.rules
        offset = abs(self.tracker.offset)
        self._count_laps(t)
        self._join_distance += abs(motion.speed) * (t - self._last_t)
        if self.phase is Phase.JOINING and self._is_in_lane(motion):
            self.phase = Phase.FOLLOWING
        if self.phase is Phase.JOINING or self.tracker.s < self.begun_at + START_DISTANCE:
            self.driven.start_figures()
        if self.phase is Phase.STOPPING:
            return
        if self.rules.odometry or self._position_std(motion) < MAX_STD_SHARE * rules.lane:
            self._certain_t = t
        if t - self._located_t > (MAX_BRIDGED_GAP if self._can_bridge(motion) else MAX_POSE_GAP):
            self._end(f"the pose was lost: {motion.tracking} for {t - self._located_t:.1f} s")
        elif (self.phase is Phase.FOLLOWING and t - self._certain_t > MAX_POSE_GAP
              and not self.doubts):  # a doubted speed has a reason of its own, below
            self._end(f"the position is uncertain: a standard error of "
                      f"{self._position_std(motion):.2f} m in a lane of {rules.lane:g} m to each "
                      "side")
        elif self.phase is Phase.FOLLOWING and offset > rules.lane:
            self._end(f"the car left the lane: {offset:.2f} m off the path at "
                      f"{self.tracker.s % self.path.length:.2f} m")
        elif self.phase is Phase.JOINING and offset > MAX_START_DISTANCE + rules.lane:
            self._end(f"the car went away from the path before it was in the lane: {offset:.2f} m")
        elif self.phase is Phase.JOINING and self._join_distance > MAX_JOIN_DISTANCE:
            self._end(f"the car did not come into the lane within {MAX_JOIN_DISTANCE:g} m")
        elif self.tracker.why:
            self._end(self.tracker.why)
        elif self._stuck_detector.is_stuck(
            t, motion.speed if min(self.cap, self.free) >= CRAWL_SPEED else inf
        ):
            self._end(f"an obstacle has been before the car for {STUCK_TIME:g} s"
                      if self.obstructed else
                      f"the car does not move, though commanded to for {STUCK_TIME:g} s"
                      + (f": {self.doubts} of its speed, so throttle is withheld"
                         if self.doubts else ""))
        elif self._t0 is not None and t - self._t0 > rules.duration:
            self._end(f"the time of {rules.duration:g} s is over", good=True)
        elif self.remaining <= 0.0:
            self._end("the path is driven", good=True)

    def _can_bridge(self, motion: MotionEstimate) -> bool:
        return (motion.tracking is Tracking.DEAD_RECKONING and self.silent()
                and 3.0 * self._position_std(motion) < self.rules.lane)

    @staticmethod
    def _position_std(motion: MotionEstimate) -> float:
        """Return the larger standard error of x and y [m]."""
        return sqrt(max(float(motion.cov[0, 0]), float(motion.cov[1, 1])))

    def _turn_offset(self, pose: Pose, s: float, offset: float, delay_distance: float) -> float:
        """Return the offset [m] at which the car will be parallel to the path again.

        1. psi: heading of the car minus that of the path. The car turns back with its tightest
           curvature 1/R to that side; the path bends towards it or away by its own curvature.
        2. An arc of radius R changes the offset by R (1 - cos psi).
        3. Before it, the car drives straight until its steering acts: ``delay_distance`` sin psi.
        """
        point = self.path.interpolate(s)
        psi = remainder(pose.yaw - point.heading, tau)
        right, left = self.plant.lock
        wheelbase = self.plant.vehicle.body.wheelbase
        tightest = tan(abs(right if psi > 0.0 else left)) / wheelbase
        side = 1.0 if psi > 0.0 else -1.0
        relative = max(tightest + side * point.curvature, 0.1 * tightest)
        return offset + side * ((1.0 - cos(psi)) / relative + delay_distance * abs(sin(psi)))

    def _is_in_lane(self, motion: MotionEstimate) -> bool:
        """Return whether the car is in the lane and will be when it has turned along the path."""
        limit = SHARE_OF_LANE * self.rules.lane
        delay = self.plant.delay
        speed = max(motion.speed, min(self.cap, self.free, self.profile.speed_at(self.tracker.s)))
        after = self._turn_offset(motion.pose, self.tracker.s, self.tracker.offset,
                                  speed * (delay.transport + delay.lag + delay.yaw_delay))
        return max(abs(self.tracker.offset), abs(after)) < limit

    def _check_turn(self, pose: Pose) -> None:
        """Raise UsageError for a start whose first turn leads too far away from the path."""
        offset = self.path.offset(pose.x, pose.y, self.begun_at)
        # The car is at rest: its steering acts before it has moved.
        after = self._turn_offset(pose, self.begun_at, offset, 0.0)
        if abs(after) > MAX_START_DISTANCE:
            heading = self.path.interpolate(self.begun_at).heading
            raise UsageError(
                f"the first turn would lead the car {abs(after):.2f} m away from the path",
                found=f"{abs(offset):.2f} m from it at rest, and "
                      f"{abs(remainder(pose.yaw - heading, tau)):.2f} rad off its direction",
                expected=f"at most {MAX_START_DISTANCE:g} m until the car is parallel to the path",
                remedy=f"turn the car towards the path, or to {heading:.2f} rad, or move it nearer")

    def _count_laps(self, t: float) -> None:
        laps = len(self.driven.lap_times) + 1
        if self.path.closed and self.tracker.s >= self.begun_at + laps * self.path.length:
            self.driven.lap_times.append(t - self._lap_t)
            self._lap_t = t

    def _pace_at(self, s: float) -> float:
        """Return the target speed [m/s] at an arc length [m]."""
        if self.phase is Phase.STOPPING:
            return self._speed
        speed = self.profile.speed_at(s) * (self.ramp.factor if self.ramp else 1.0)
        return max(min(speed, self.cap, self.free), CRAWL_SPEED)

    def _target_speed(self, motion: MotionEstimate) -> float:
        """Return the speed to command [m/s]."""
        if self.phase is Phase.STOPPING:
            return self._stop_speed(motion)
        self._speed = min(self._pace_at(self.tracker.s), max(self.tracker.speed, CRAWL_SPEED))
        if min(self.cap, self.free) < CRAWL_SPEED:  # no motor turns so slowly
            self._speed = 0.0
        if not self.path.closed:
            remaining = max(self.remaining, 0.0)
            if (
                remaining <= motion.speed**2 / (2.0 * ROLL_DECELERATION)
                and motion.speed < 2.0 * CRAWL_SPEED
            ):
                self._end("the path is driven", good=True)
                return 0.0
            self._speed = min(
                self._speed, max(sqrt(2.0 * STOP_DECELERATION * remaining), CRAWL_SPEED)
            )
        return self._speed


def find_start(path: Path, pose: Pose) -> float:
    """Return the arc length [m] of the closest point whose direction is that of the car.

    Searches the whole path. Raises UsageError if the point is further than ``MAX_START_DISTANCE``,
    or if the path has the opposite direction.
    """
    distance = np.hypot(path.x - pose.x, path.y - pose.y)
    same_direction = np.cos(path.heading - pose.yaw) > 0.0
    k = int(np.argmin(np.where(same_direction, distance, inf)))
    if same_direction.any() and distance[k] <= MAX_START_DISTANCE:
        return path.closest(pose.x, pose.y, float(path.s[k]))
    nearest = int(np.argmin(distance))
    location = f"the car is at x {pose.x:.2f} y {pose.y:.2f} m, {pose.yaw:.2f} rad"
    if distance[nearest] <= MAX_START_DISTANCE:
        raise UsageError("the car points against the path", found=location,
                         expected=f"a heading within 90 deg of {path.heading[nearest]:.2f} rad, "
                                  "the direction of the path",
                         remedy="turn the car round, or start the path at the car with --here")
    raise UsageError(
        f"the car is {distance[nearest]:.2f} m away from the path", found=location,
        expected=f"within {MAX_START_DISTANCE:g} m; the path is nearest at x {path.x[nearest]:.2f} "
                 f"y {path.y[nearest]:.2f} m",
        remedy="move the car there, or start the path at the car with --here")


def _end_distance(path: Path) -> float:
    end = path.interpolate(path.length)
    return hypot(end.x - float(path.x[0]), end.y - float(path.y[0]))
