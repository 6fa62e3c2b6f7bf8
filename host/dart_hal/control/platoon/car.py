"""One car of a platoon: from its motion and the car ahead to steering and speed.

Lateral: a tracker of ``control.trackers`` follows the path by external poses, or ``by_lane`` the
middle between the boards that the lidar finds. Longitudinal: the acceleration of
``PlatoonFollower`` (of the first car: of ``leader``, or of a function) is integrated to a speed;
``Car.drive_speed`` computes the throttle by the identified model.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, inf, sin

import numpy as np

from dart_hal.control.ending import MAX_POSE_GAP, is_located
from dart_hal.control.follow import DriveCommand, find_start
from dart_hal.control.lap import CRAWL_SPEED
from dart_hal.control.mpc.tracker import DEFAULT_HALF_WIDTH
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.platoon.by_lane import LaneTracker
from dart_hal.control.platoon.follower import Gap, PlatoonFollower, PlatoonMode
from dart_hal.control.platoon.gains import PlatoonGains
from dart_hal.control.platoon.hearing import MAX_ACCELERATION_AGE, PredecessorReport
from dart_hal.control.platoon.laws import clip
from dart_hal.control.platoon.laws import leader as leader_acceleration
from dart_hal.control.platoon.spacing import gap_from_pose, measure_gap
from dart_hal.control.trackers import TRACKERS
from dart_hal.core.types import FloatArray, MotionEstimate, Scan

# Number of stored poses: 0.5 s of States, a scan takes 0.13 s.
MAX_QUEUED_POSES = 50
# s by which the speed of the car follows its command. Without it cars at 1 m/s came to rest 0.07 to
# 0.08 m after the end of their path in simulation; twice that.
SPEED_LAG = 0.15
# Largest difference between the commanded speed and the car's [m/s]: the loop catches up.
MAX_SPEED_LEAD = 0.3


@dataclass(frozen=True, slots=True)
class PredecessorState:
    """State that the predecessor reports: x, y [m] of its rear axle, speed [m/s], acceleration
    [m/s2], at t [s] of the own clock.
    """

    t: float
    x: float
    y: float
    speed: float
    acceleration: float


class PlatoonCar:
    """One drive: call ``answer`` once per State.

    drives (t [s], speed [m/s]): acceleration [m/s2] of a leader, which has no follower. tracker: of
    ``TRACKERS``, or "lane".

    ``u`` [m/s2]: commanded acceleration; ``last_gap``: by the lidar; ``offset`` [m]: from
    the path. ``mode``, ``why``: of the follower, but STOP if the own pose or the lane is lost.
    """

    def __init__(self, path: Path, plant: Plant, follower: PlatoonFollower | None = None, *,
                 gains: PlatoonGains | None = None, tracker: str = "lqr",
                 drives: Callable[[float, float], float] | None = None, dt: float = 0.05) -> None:
        self.path = path
        self.plant = plant
        self.follower = follower
        if gains is None:
            gains = PlatoonFollower().gains if follower is None else follower.gains
        self.gains = gains
        self.tracker = (
            LaneTracker(path, plant) if tracker == "lane" else TRACKERS[tracker](path, plant)
        )
        self._tables = plant.gains  # created now, not during the drive
        self.tracker.pace = lambda s: max(self._target_speed, CRAWL_SPEED)
        self.u = 0.0
        self.last_gap: Gap | None = None
        self.mode = PlatoonMode.STOP
        self.why = "no pose came yet"
        self._leader_law = drives or (lambda t, speed: leader_acceleration(self.gains, speed))
        self._dt = follower.dt if follower is not None else dt
        self._target_speed = 0.0
        self._next_t = -inf
        self._located_t = -inf
        self._poses: deque[tuple[float, ...]] = deque(maxlen=MAX_QUEUED_POSES)
        self._new_gap: Gap | None = None
        self._has_joined = False
        self._ended = ""

    @property
    def offset(self) -> float:
        """Distance to the left of the path [m]."""
        return self.tracker.offset

    def answer(self, motion: MotionEstimate, scans: Sequence[Scan] = (),
               predecessor: PredecessorState | None = None) -> DriveCommand:
        """Return the command at ``motion.t``.

        scans: new ones; predecessor: newest report, of any age. Raises UsageError for a start that
        is too far from the path.
        """
        t = motion.t
        pose = motion.pose
        if is_located(motion):
            if self._located_t == -inf:
                self.tracker.begin(find_start(self.path, pose))
                self._next_t = t
            self._located_t = t
        if self._located_t == -inf:
            return DriveCommand(0.0, 0.0)
        if isinstance(self.tracker, LaneTracker):
            self.tracker.add_scans(scans)
        steering = self.tracker.steer(motion)
        since = t - self._poses[-1][0] if self._poses else 0.0
        self._poses.append((t, pose.x, pose.y, pose.yaw, self.tracker.s))
        for scan in scans:
            self._measure_gap(scan)
        if predecessor is not None:
            self._take_report(predecessor, t)
        if t >= self._next_t - 1e-6:
            # After a pause the missed steps are not made up for: each would be of full length.
            self._next_t += self._dt
            if self._next_t <= t:
                self._next_t = t + self._dt
            self.u = self._choose_acceleration(t, max(motion.speed, 0.0), predecessor)
        self._target_speed = self._integrate_speed(since, max(motion.speed, 0.0))
        return DriveCommand(steering, self._target_speed)

    def plan(self, motion: MotionEstimate, reported: float | None = None) -> FloatArray:
        """Return two points (2, 4) for ``Member.tell_plan`` with a step of ``dt``: now, and one
        step later.

        reported [m/s2]: acceleration of the plan instead of the commanded one.
        """
        pose = motion.pose
        v = max(motion.speed, 0.0)
        dt = self._dt
        u = self.u if reported is None else reported
        end = v + u * dt if reported is not None else max(v + u * dt, 0.0)
        distance = 0.5 * (v + end) * dt
        return np.array(
            (
                (pose.x, pose.y, pose.yaw, v),
                (
                    pose.x + distance * cos(pose.yaw),
                    pose.y + distance * sin(pose.yaw),
                    pose.yaw,
                    end,
                ),
            )
        )

    def _measure_gap(self, scan: Scan) -> None:
        """Measure the gap by one revolution."""
        t, x, y, yaw, s = np.array(self._poses).T
        points = scan.points(lambda at: (np.interp(at, t, x), np.interp(at, t, y),
                                         np.interp(at, t, yaw)))
        good = np.isfinite(points[:, 0]) & (scan.t >= t[0])
        at = scan.t[good]
        found = measure_gap(points[good], at, self.path, np.interp(at, t, s))
        if found is not None:
            self.last_gap = self._new_gap = found

    def _take_report(self, predecessor: PredecessorState, t: float) -> None:
        """Pass a report to the follower; without a gap by the lidar also its position."""
        if self.follower is None:
            return
        is_new = self.follower.hearing.take(
            PredecessorReport(predecessor.t, predecessor.speed, predecessor.acceleration), t
        )
        if (
            is_new
            and t - predecessor.t <= MAX_ACCELERATION_AGE
            and (self.last_gap is None or t - self.last_gap.t > MAX_ACCELERATION_AGE)
        ):
            table = np.array(self._poses)
            s = float(np.interp(predecessor.t, table[:, 0], table[:, 4]))
            self._new_gap = gap_from_pose(predecessor.x, predecessor.y, predecessor.t, self.path, s)

    def _choose_acceleration(
        self, t: float, speed: float, predecessor: PredecessorState | None
    ) -> float:
        """Return the acceleration [m/s2] for the next step."""
        self._ended = self._ended or self._find_end(speed)
        lost = ("the pose is lost" if t - self._located_t > MAX_POSE_GAP
                else self.tracker.why or self._ended)
        if self.follower is None:
            self.mode, self.why = (PlatoonMode.STOP, lost) if lost else (PlatoonMode.LEAD, "")
            return self.gains.u_min if lost else clip(self.gains, self._leader_law(t, speed))
        u = self.follower.answer(t, speed, self._new_gap)
        self._new_gap = None
        self.mode = self.follower.mode
        self.why = self.follower.why
        if lost:
            self.mode = PlatoonMode.STOP
            self.why = lost
        return self.gains.u_min if lost else u

    def _find_end(self, speed: float) -> str:
        """Return why the car must stop: the path ends, or it has left its lane; else ""."""
        offset = abs(self.tracker.offset)
        self._has_joined = self._has_joined or offset < 0.5 * DEFAULT_HALF_WIDTH
        if self._has_joined and offset > DEFAULT_HALF_WIDTH:
            return f"{offset:.2f} m from the path"
        if self.path.closed:
            return ""
        stopping = speed * (self._dt + SPEED_LAG) + speed**2 / (2.0 * abs(self.gains.u_min))
        return "the path ends" if self.path.length - self.tracker.s < stopping else ""

    def _integrate_speed(self, since: float, speed: float) -> float:
        """Return the speed [m/s] to command."""
        target = self._target_speed + self.u * since
        target = min(
            max(target, speed - MAX_SPEED_LEAD, 0.0), speed + MAX_SPEED_LEAD, self.gains.v_max
        )
        return target if target > CRAWL_SPEED or self.u > 0.0 else 0.0


# Name of version 0.1.
Ahead = PredecessorState
