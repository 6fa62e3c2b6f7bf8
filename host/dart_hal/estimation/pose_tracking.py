"""Tracking of external poses: the last accepted pose and the odometry since.

    room(t) = pose(t0) + R(offset) (odometry(t) - odometry(t0))

The covariance grows with the errors of wheels and gyro since then, and with the
unknown position of the marker. A pose that the car cannot have reached is
rejected, and so is one that does not move while the wheels turn (false lock).
The track is resumed where poses have moved as the car did for ``CONFIRMATION_DISTANCE``
metres: at rest a right pose cannot be distinguished from a wrong one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from enum import Enum
from itertools import pairwise
from math import atan2, cos, hypot, inf, sin, sqrt, tau
from typing import NamedTuple

import numpy as np

from dart_hal.core.clock_fit import ClockFit
from dart_hal.core.types import External, ExternalPose, Pose, Tracking

# m: steps of the mocap above are outliers in the published recordings.
POSE_STEP = 0.06
# rad.
YAW_STEP = 0.2
# Standard deviations: 1 in 16 000 by chance, once in two and a half minutes of 100 Hz.
POSE_GATE_SIGMAS = 4.0
# m: largest distance of the marker from the rear axle (0.115 m in the published recordings);
# odometry turns about the axle.
MAX_MARKER_OFFSET = 0.15
# rad: largest angle to the car's heading (0.027 rad there).
MAX_MARKER_YAW = 0.05
# s of a false lock, as in the published recordings.
FALSE_LOCK_TIME = 0.3
# m/s: the mocap is slower.
MAX_LOCKED_SPEED = 0.05
# m/s: the wheels are faster.
MIN_WHEEL_SPEED = 0.25
# m of the car's travel along which poses must agree before the track is resumed.
CONFIRMATION_DISTANCE = 0.25
# s for which the last pose counts as current.
MAX_FRESH_AGE = 0.05
# The same in mean intervals of the source; the larger one counts.
MAX_FRESH_STEPS = 2.5
# s without an accepted pose: a gyro drift of 1 deg/s is 5 deg by then.
LOST_AFTER = 5.0
# Distance of the poses over that of the car, along ``CONFIRMATION_DISTANCE``: an uncalibrated gyro
# and wheels are off by less, another body by more.
MIN_DISTANCE_RATIO = 0.7
MAX_DISTANCE_RATIO = 1.4
# rad between both.
MAX_DIRECTION_ERROR = 0.5
# s over which the velocity at a pose is taken: five States.
VELOCITY_TIME = 0.05
# s of odometry stored for poses that arrive late.
ODOMETRY_HISTORY = 2.0


class _TimedPose(NamedTuple):
    """An external pose, the time [s] of its measurement and the odometry at that time."""

    t: float
    pose: ExternalPose
    odometry: Pose


class PoseOutcome(Enum):
    """Result of ``PoseTracker.add``."""

    FIRST = "first pose"
    CONSISTENT = "consistent with the last accepted pose"
    RELOCATED = "track resumed elsewhere: the poses have moved there as the car did"
    FALSE_LOCK = "false lock since the returned time"
    UNREACHABLE = "not reachable by the car"
    # Also the first poses, while there is no odometry yet.
    OUTDATED = "older than the newest pose"


class PoseTracker:
    """One per open car: ``update`` for each State, ``add`` for each pose, then ``estimate_at``.

    own_clock: stamps are on the clock of the car, as those of its own lidar. latency, latency_std
    [s]: time from a measurement to its stamp, beyond the smallest delay of the network.
    """

    def __init__(self, *, own_clock: bool = False, latency: float = 0.0,
                 latency_std: float = 0.0) -> None:
        self._own_clock = own_clock
        self._latency = latency
        self._latency_std = latency_std
        self._clock = ClockFit(byte_time=0.0, latch_delay=0.0)
        self._first_stamp: float | None = None
        self._stamp = -inf
        self._odometry: deque[tuple[float, Pose]] = deque()
        self._accepted: deque[_TimedPose] = deque()
        self._candidates: list[_TimedPose] = []
        self._newest: ExternalPose | None = None
        self._newest_t = -inf
        self._step = 0.01

    def update(self, t: float, odometry: Pose) -> None:
        """Add the odometry of the State at t [s]."""
        stored = self._odometry
        if stored and t <= stored[-1][0]:
            return
        stored.append((t, odometry))
        while stored[0][0] < t - ODOMETRY_HISTORY:
            stored.popleft()

    def add(self, pose: ExternalPose) -> tuple[PoseOutcome, float]:
        """Add a received pose; one out of order only becomes ``External.newest``.

        Returns the outcome and the time [s] of its measurement on the clock of the car.
        """
        self._newest = pose
        if self._first_stamp is None:
            self._first_stamp = pose.stamp
        if pose.stamp <= self._stamp or not self._odometry:
            return PoseOutcome.OUTDATED, pose.arrival
        self._stamp = pose.stamp
        since = pose.stamp - self._first_stamp
        self._clock.add_frame(since, pose.arrival, 0.0)
        measured = pose.stamp if self._own_clock else self._clock.to_host(since)[0]
        t = min(measured, pose.arrival) - self._latency
        self._step += 0.1 * (min(t - self._newest_t, 1.0) - self._step)
        self._newest_t = t
        fix = _TimedPose(t, pose, self._odometry_at(t))
        if not self._candidates and self._is_plausible(fix):
            return self._accept(fix)
        return self._confirm_candidates(fix)

    def estimate_at(self, t: float) -> External:
        """Return the external pose for the State at t [s], the newest given to ``update``."""
        if not self._accepted:
            return External(Tracking.JUMPED if self._candidates else Tracking.LOST, inf, None,
                            self._newest)
        last = self._accepted[-1]
        age = max(t - last.t, 0.0)
        fresh = self._latency + max(MAX_FRESH_AGE, MAX_FRESH_STEPS * self._step)
        if self._candidates and t - self._newest_t <= fresh:
            tracking = Tracking.JUMPED
        elif age <= fresh:
            tracking = Tracking.TRACKING
        else:
            tracking = Tracking.DEAD_RECKONING if age <= LOST_AFTER else Tracking.LOST
        pose = propagate_pose(last.pose, last.odometry, self._odometry_at(t))
        return External(tracking, age, self._add_latency_error(pose, last), self._newest)

    def _add_latency_error(self, pose: Pose, fix: _TimedPose) -> Pose:
        """Add the error of the latency: the motion of the car in that time, at the measurement."""
        moved = _move_marker(fix.pose, self._odometry_at(fix.t - VELOCITY_TIME), fix.odometry)
        x, y, yaw = (after - before for after, before in zip(
            moved, (fix.pose.x, fix.pose.y, fix.pose.yaw), strict=True))
        error = np.array((x, y, yaw)) * (self._latency_std / VELOCITY_TIME)
        cov = pose.cov + np.outer(error, error)
        cov.setflags(write=False)
        return replace(pose, cov=cov)

    def _odometry_at(self, t: float) -> Pose:
        """Interpolate the odometry linearly; beyond the newest State extrapolate the last step."""
        stored = self._odometry
        k = len(stored) - 1
        while k > 1 and stored[k - 1][0] > t:
            k -= 1
        if k < 1 or t >= stored[-1][0] + MAX_FRESH_AGE or t == stored[k][0]:
            return stored[-1][1] if t > stored[-1][0] else stored[k][1]
        (t0, a) = stored[k - 1]
        (t1, b) = stored[k]
        fraction = max((t - t0) / (t1 - t0), 0.0)
        return Pose(a.x + fraction * (b.x - a.x), a.y + fraction * (b.y - a.y),
                    a.yaw + fraction * (b.yaw - a.yaw), b.cov)

    def _is_plausible(self, fix: _TimedPose) -> bool:
        """Whether the car can have come from the last accepted pose to this one."""
        return not self._accepted or _is_reachable(self._accepted[-1], fix)

    def _accept(self, fix: _TimedPose) -> tuple[PoseOutcome, float]:
        """Accept a pose, unless the poses have not moved for a while although the wheels turned."""
        accepted = self._accepted
        outcome = PoseOutcome.CONSISTENT if accepted else PoseOutcome.FIRST
        accepted.append(fix)
        while len(accepted) > 1 and accepted[0].t < fix.t - ODOMETRY_HISTORY:
            accepted.popleft()
        start = next((old for old in reversed(accepted) if old.t <= fix.t - FALSE_LOCK_TIME), None)
        if start is None:
            return outcome, fix.t
        seconds = fix.t - start.t
        driven = _distance(start.odometry, fix.odometry)
        moved = hypot(fix.pose.x - start.pose.x, fix.pose.y - start.pose.y)
        if driven > MIN_WHEEL_SPEED * seconds and moved < MAX_LOCKED_SPEED * seconds:
            while len(accepted) > 1 and accepted[-1].t > start.t:
                accepted.pop()
            self._candidates = [fix]
            return PoseOutcome.FALSE_LOCK, start.t
        return outcome, fix.t

    def _confirm_candidates(self, fix: _TimedPose) -> tuple[PoseOutcome, float]:
        """Add a pose off the track; accept again once such poses move as the car does."""
        candidates = self._candidates
        if candidates and not _is_reachable(candidates[-1], fix):
            candidates.clear()
        if not candidates and self._is_plausible(fix):
            return self._accept(fix)
        candidates.append(fix)
        start = candidates[0]
        travel = sum(_distance(a.odometry, b.odometry) for a, b in pairwise(candidates))
        if travel >= CONFIRMATION_DISTANCE:
            if _is_reachable(start, fix) and _is_same_motion(start, fix):
                candidates.clear()
                self._accepted.clear()
                self._accepted.append(fix)
                return PoseOutcome.RELOCATED, fix.t
            self._candidates = [fix]
        return PoseOutcome.UNREACHABLE, fix.t


def _move_marker(pose: ExternalPose, start: Pose, end: Pose) -> tuple[float, float, float]:
    """Move a marker pose by the odometry from ``start`` to ``end``; return x, y, yaw."""
    rotation = pose.yaw - start.yaw
    c = cos(rotation)
    s = sin(rotation)
    ox = end.x - start.x
    oy = end.y - start.y
    return pose.x + c * ox - s * oy, pose.y + s * ox + c * oy, pose.yaw + end.yaw - start.yaw


def propagate_pose(pose: ExternalPose, start: Pose, end: Pose) -> Pose:
    """Move a marker pose, with its covariance, by the odometry from ``start`` to ``end``.

    The error of the odometry is taken as equal in all directions, and as
    independent of the pose: an upper bound.
    """
    x, y, yaw = _move_marker(pose, start, end)
    ox = end.x - start.x
    oy = end.y - start.y
    xx, xt, yy, yt, tt = (float(start.cov[i]) for i in ((0, 0), (0, 2), (1, 1), (1, 2), (2, 2)))
    # Error of the way of the marker, which is off the axle by an unknown vector and yaw.
    marker_variance = ((MAX_MARKER_OFFSET * (end.yaw - start.yaw))**2
                       + (MAX_MARKER_YAW**2) * (ox * ox + oy * oy))
    position_variance = marker_variance + (
        max(float(end.cov[0, 0]) - (xx - 2.0 * oy * xt + oy * oy * tt), 0.0)
        + max(float(end.cov[1, 1]) - (yy + 2.0 * ox * yt + ox * ox * tt), 0.0))
    yaw_variance = max(float(end.cov[2, 2]) - tt, 0.0)
    lever = np.array(((1.0, 0.0, pose.y - y), (0.0, 1.0, x - pose.x), (0.0, 0.0, 1.0)))
    cov = lever @ pose.cov @ lever.T
    cov[(0, 1, 2), (0, 1, 2)] += (position_variance, position_variance, yaw_variance)
    cov.setflags(write=False)
    return Pose(x, y, yaw, cov)


def _distance(a: Pose, b: Pose) -> float:
    """Distance of two poses [m]."""
    return hypot(b.x - a.x, b.y - a.y)


def _is_reachable(a: _TimedPose, b: _TimedPose) -> bool:
    """Whether the car can have come from a to b, by its odometry and its errors."""
    x, y, yaw = _move_marker(a.pose, a.odometry, b.odometry)
    error = hypot(b.pose.x - x, b.pose.y - y)
    yaw_error = b.pose.yaw - yaw
    yaw_error = abs(yaw_error - tau * round(yaw_error / tau))
    if error <= POSE_STEP and yaw_error <= YAW_STEP:
        return True
    predicted = propagate_pose(a.pose, a.odometry, b.odometry)
    external_cov = b.pose.cov
    position_std = sqrt(float(predicted.cov[0, 0] + predicted.cov[1, 1]
                        + external_cov[0, 0] + external_cov[1, 1]))
    yaw_std = sqrt(float(predicted.cov[2, 2] + external_cov[2, 2]))
    return (error <= POSE_STEP + POSE_GATE_SIGMAS * position_std
            and yaw_error <= YAW_STEP + POSE_GATE_SIGMAS * yaw_std)


def _is_same_motion(a: _TimedPose, b: _TimedPose) -> bool:
    """Whether the pose moved as far as the car did, and in the same direction."""
    x, y, _ = _move_marker(a.pose, a.odometry, b.odometry)
    ax = x - a.pose.x
    ay = y - a.pose.y
    bx = b.pose.x - a.pose.x
    by = b.pose.y - a.pose.y
    angle = atan2(ax * by - ay * bx, ax * bx + ay * by)
    driven = hypot(ax, ay)
    distance = hypot(bx, by)
    longest = MAX_DISTANCE_RATIO * driven + POSE_STEP
    return MIN_DISTANCE_RATIO * driven < distance < longest and abs(angle) < MAX_DIRECTION_ERROR
