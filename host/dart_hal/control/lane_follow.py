"""Driving in the middle of a lane by the lidar alone: which steering and speed to command.

    WAITING ---> FOLLOWING ---> STOPPING ---> ENDED
     no lane      in it          slows down    at rest

Each scan shows the whole lane (``lane``); between two scans the model predicts the car's pose in it
(``lane_model``). Steering is pure pursuit (``pursuit.arc``) of a point at a look-ahead distance
from the pose at which the command acts. The car can always stop within the visible lane.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from math import inf, sqrt

import numpy as np

from dart_hal.control.drive_record import DriveRecord
from dart_hal.control.ending import MAX_POSE_GAP, MAX_START_WAIT, Ending, Phase
from dart_hal.control.follow import DriveCommand
from dart_hal.control.lane import LaneView, find_lane
from dart_hal.control.lane_model import LaneReckoning
from dart_hal.control.lap import BEND_SPEED_SHARE, CRAWL_SPEED
from dart_hal.control.mpc.obstacles import HALF_WIDTH
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.pursuit import arc
from dart_hal.control.stopping import ROLL_DECELERATION, STOP_DECELERATION, STUCK_TIME
from dart_hal.core.types import FloatArray, Pose, Scan

# Look-ahead distance [m] and time [s]: 0.3 m at 1 m/s, 0.5 m at 2 m/s. With 0.5 m at 1 m/s the play
# of the linkage, 1 to 2 deg, moves the car by 1.5 cm, with 0.3 m by 0.8 cm; at 2 m/s a scan is 0.5
# m old.
MIN_LOOK_AHEAD = 0.1
LOOK_AHEAD_TIME = 0.2
# Length of the car before the rear axle, and a reserve [m].
FRONT_DISTANCE = 0.3
# Function that finds a lane in the points (m, 2) [m] of a scan, from the pose of the car on.
LaneFinder = Callable[[FloatArray, Pose], LaneView]
# Length over which the curvature ahead is averaged [m]: noise of 1 cm is a bend of 8 m.
CURVATURE_LENGTH = 0.6
# Lanes that are kept: those of ten minutes at 7 Hz, 1 MB.
MAX_LANES = 4200


class LaneFollower(Ending):
    """One drive. Call ``answer`` once per State, with the new scans, until ``phase`` is ENDED;
    ``why`` is then the reason of the end, ``good`` whether it was intended.

    ``cap`` [m/s] may be set at any time; distance [m] and duration [s]: limits from the beginning
    on. ``path``: the lane ahead by the last scan, in the frame of ``model``; ``half`` [m]: its half
    width; ``driven``: rows as those of ``Follower``, with x, y in that frame. half_width [m]: of
    the car, which ends before it touches a board.
    """

    end_reason = "the lane ends"
    """Reason of the end if the lane is driven to its end."""

    def __init__(self, plant: Plant, cap: float, distance: float = inf,
                 duration: float = inf, find_lane: LaneFinder = find_lane,
                 half_width: float = HALF_WIDTH) -> None:
        super().__init__()
        self._half_width = half_width
        self.plant = plant
        self.cap = cap
        self.distance = distance
        self.duration = duration
        self.model = LaneReckoning(plant)
        self._max_speed = plant.steady.max_speed  # creates its tables now, not during the drive
        self.path: Path | None = None
        self.half = self.s = self.offset = 0.0
        self.driven = DriveRecord()
        self.lane_history: deque[tuple[float, float, float, float]] = deque(maxlen=MAX_LANES)
        """x, y [m], heading [rad] of the lane at the car and its half width [m], by the newest
        scans."""
        self._find_lane = find_lane
        self._view: LaneView | None = None
        self._start_t = self._lane_t = self._scan_t = -inf

    def answer(self, t: float, speed: float, scans: Sequence[Scan] = ()) -> DriveCommand:
        """Return the command at t [s], with the wheel speed [m/s] and the new scans."""
        if self._start_t == -inf:
            self._start_t = self._lane_t = self._scan_t = self._last_t = t
        now = self.model.advance(t, speed)
        for scan in scans:
            self._take_scan(scan)
        if self.phase is Phase.WAITING:
            if self.path is None:
                if t - self._start_t > MAX_START_WAIT:
                    self._end(f"{self._describe_fault()} within {MAX_START_WAIT:g} s", Phase.ENDED)
                return DriveCommand(0.0, 0.0)
            self.phase = Phase.FOLLOWING
            self._start_t = t
        if self.phase is Phase.ENDED or self.path is None:
            return DriveCommand(0.0, 0.0)
        self.s = self.path.closest(now.pose.x, now.pose.y, self.s)
        self.offset = self.path.offset(now.pose.x, now.pose.y, self.s)
        self._check_end(t)
        target_speed = self._target_speed(speed)
        self.driven.add(t, now.pose.x, now.pose.y, self.offset, speed, target_speed,
                        self.model.distance)
        self._last_t = t
        return DriveCommand(self._steer(self.path), target_speed)

    @property
    def fastest(self) -> float:
        """Largest speed that may be commanded [m/s]."""
        return self.cap

    def describe(self) -> str:
        """Return a text about the visible lane."""
        ahead = self.path.length if self.path else 0.0
        return f"a lane {200.0 * self.half:.0f} cm wide, visible for {ahead:.1f} m"

    def _take_scan(self, scan: Scan) -> None:
        """Find the lane in a scan."""
        self._scan_t = self.model.now.t
        self._view = view = self._find_lane(self.model.points(scan), self.model.now.pose)
        if not view.is_complete or len(view.middle) < 3:
            return
        lane = Path.through(view.middle, closed=False)
        if self.path is not None:
            self._learn_errors(self.path, lane)
        self.path = lane
        self.half = view.half
        self.s = 0.0
        self._lane_t = self.model.now.t
        self.lane_history.append((*view.middle[0].tolist(), float(lane.heading[0]), view.half))

    def _learn_errors(self, last_path: Path, path: Path) -> None:
        """Learn the errors of the model from the lane in two successive scans."""
        self.model.compare(last_path, path)

    def _steer(self, path: Path) -> float:
        """Return the angle [rad] of the road wheels to command."""
        delay = self.plant.delay
        low, high = self.plant.lock
        future = self.model.predict(
            self.model.now.t + delay.transport + delay.yaw_delay + delay.lag
        )
        look_ahead = MIN_LOOK_AHEAD + LOOK_AHEAD_TIME * abs(future.speed)
        target = path.interpolate(path.closest(future.x, future.y, self.s) + look_ahead)
        curvature = arc(future.x, future.y, future.course(self.plant), target.x, target.y)
        angle = self.plant.steady.turn(curvature, future.speed).angle - self.model.trim
        angle = min(max(angle, low), high)
        self.model.record_command(angle)
        return angle

    def _check_end(self, t: float) -> None:
        """End the drive if a condition requires it."""
        if self.phase is Phase.STOPPING:
            return
        if t - self._lane_t > MAX_POSE_GAP:
            self._end(f"{self._describe_fault()} for {t - self._lane_t:.1f} s")
        elif 0.0 < self.half < abs(self.offset) + self._half_width:
            self._end(f"the car left the lane: {100.0 * abs(self.offset):.0f} cm from its middle, "
                      f"in a lane {200.0 * self.half:.0f} cm wide")
        elif self._stuck_detector.is_stuck(
                t, self.model.now.speed if self.cap >= CRAWL_SPEED else inf):
            self._end(f"the car does not move, though commanded to for {STUCK_TIME:g} s")
        elif t - self._start_t > self.duration:
            self._end(f"the time of {self.duration:g} s is over", good=True)
        elif self.model.distance > self.distance:
            self._end(f"{self.distance:g} m are driven", good=True)

    def _describe_fault(self) -> str:
        """Return why there is no lane."""
        view = self._view
        if view is None or self.model.now.t - self._scan_t > 0.5 * MAX_POSE_GAP:
            return "the lidar is silent"
        if view.left or view.right:
            return f"only the {'left' if view.left else 'right'} board is visible"
        return "no boards are visible"

    def _target_speed(self, speed: float) -> float:
        """Return the speed to command [m/s]."""
        if self.phase is Phase.STOPPING:
            return self._stop_speed(self.model.now)
        assert self.path is not None
        remaining = max(self.path.length - self.s - FRONT_DISTANCE, 0.0)
        if remaining <= speed**2 / (2.0 * ROLL_DECELERATION) and speed < 2.0 * CRAWL_SPEED:
            self._end(self.end_reason, good=True)
            return 0.0
        self._speed = max(
            min(self.cap, self._bend_speed(self.path), sqrt(2.0 * STOP_DECELERATION * remaining)),
            CRAWL_SPEED,
        )
        if self.cap < CRAWL_SPEED:  # no motor turns so slowly
            self._speed = 0.0
        return self._speed

    def _bend_speed(self, path: Path) -> float:
        """Return the speed [m/s] that the tyres allow in the bends ahead."""
        n = max(round(CURVATURE_LENGTH / path.spacing), 1)
        curvatures: FloatArray = (path.heading[n:] - path.heading[:-n]) / CURVATURE_LENGTH
        return BEND_SPEED_SHARE * float(
            np.min(self._max_speed(curvatures, self.plant.lock), initial=inf)
        )


class WallFollower(LaneFollower):
    """Follower of a wall, with ``look=Wall(...)``. It learns no errors of the car, because every
    scan plans a new route from the car's pose.
    """

    end_reason = "the route is blocked"

    def describe(self) -> str:
        return f"a route of {self.path.length if self.path else 0.0:.1f} m is clear"

    def _learn_errors(self, last_path: Path, path: Path) -> None:
        pass

    def _describe_fault(self) -> str:
        silent = self._view is None or self.model.now.t - self._scan_t > 0.5 * MAX_POSE_GAP
        return "the lidar is silent" if silent else self.end_reason
