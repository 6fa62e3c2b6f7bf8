"""Pose of the rear axle in the frame of an external source: selection and fusion of its poses.

``PoseTracker`` selects the external poses that are of this car; ``PoseFilter`` fuses them with
wheels and gyro. Position and latency of the marker are estimated, starting from the calibration.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import External, ExternalPose, Pose
from dart_hal.estimation.odometry import MotionStep, Odometry
from dart_hal.estimation.pose_filter import FilterEstimate, PoseFilter, PoseVerdict
from dart_hal.estimation.pose_model import MarkerModel
from dart_hal.estimation.pose_tracking import (
    CONFIRMATION_DISTANCE,
    MAX_MARKER_OFFSET,
    MAX_MARKER_YAW,
    PoseOutcome,
    PoseTracker,
)
from dart_hal.estimation.spin import SPIN_SPEED_STD, SpinDetector

# Marker of an uncalibrated source: optical systems have 3 to 15 ms of latency, 40 to 60 over a
# network; the fit of its clock already removes the smallest one.
UNKNOWN_MARKER = MarkerModel(
    latency=0.01, std=(MAX_MARKER_OFFSET, MAX_MARKER_OFFSET, MAX_MARKER_YAW, 0.02))
# m, m, rad, s: errors of poses by the car's own lidar, on the car's own clock, in addition to those
# of its mounting.
AXLE_STD = (0.001, 0.001, 0.002, 0.002)
# rad per m/s2, slip gain of the rear tyres: between 0.011 and 0.034 of the two published sets
# (``odometry.py``). At constant speed v it cannot be separated from lx: 0.01 are 1 cm at 1 m/s.
SLIP_GAIN = 0.0225
# One sigma.
SLIP_GAIN_STD = 0.016
# s of poses that the tracker accepts and the filter rejects, until the filter restarts.
MAX_OUTLIER_TIME = 0.5
# s by which the State's time may exceed the motions; more was lost in a reset of the Nano.
MAX_MOTION_GAP = 0.1


def make_axle_marker(mount_std: tuple[float, float, float]) -> MarkerModel:
    """Return the marker of poses by the car's own lidar, which are those of the rear axle.

    mount_std: standard errors of x, y [m] and yaw [rad] of the lidar's mounting.
    """
    x, y, yaw = (hypot(a, b) for a, b in zip(mount_std, AXLE_STD[:3], strict=True))
    return MarkerModel(std=(x, y, yaw, AXLE_STD[3]))


class _AcceptedPose(NamedTuple):
    """An accepted pose and the time [s] of its measurement.

    is_relocated: the track starts again there.
    """

    t: float
    external: ExternalPose
    is_relocated: bool


class ExternalPoseEstimator:
    """One per open car with a source: ``update`` for each State, ``add`` for each pose.

    odometry: that of the car, for its knowledge of the sensors at the start; own_clock: stamps
    are on the clock of the car. map_errors: standard errors of x, y [m] and yaw [rad] in the map
    of the source. They persist, so that no number of poses makes them smaller: the covariance of
    each estimate contains them.
    """

    def __init__(self, odometry: Odometry, marker: MarkerModel = UNKNOWN_MARKER, *,
                 own_clock: bool = False,
                 map_errors: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self._tracker = PoseTracker(own_clock=own_clock, latency=marker.latency,
                                    latency_std=marker.std[3])
        self._map_cov = np.diag(np.square((*map_errors, 0.0, 0.0))) if any(map_errors) else None
        marker = marker._replace(latency=0.0)
        self._filter = PoseFilter(
            replace(odometry.noise, slip_gain=SLIP_GAIN_STD), slip_gain=SLIP_GAIN,
            gyro_bias=odometry.bias.value, gyro_bias_std=odometry.bias.std, marker=marker)
        self._waiting: deque[_AcceptedPose] = deque()
        self._t: float | None = None
        # Frame of the source; None while the filter has no position in it.
        self._frame: str | None = None
        self._fused_t = 0.0
        # Start of the track, until poses have moved from there as the car did.
        self._unconfirmed: ExternalPose | None = None
        self._spin = SpinDetector()
        # m, in the axes of the dead reckoning: wheel travel during spins without motion of the car.
        self._spin_offset = (0.0, 0.0)
        # m, one sigma of the travel since the current spin began.
        self._spin_error = 0.0

    def update(self, t: float, odometry: Pose, motion: MotionStep, accel: float | None = None
               ) -> External:
        """Add the State at t [s] and return its external pose.

        odometry, motion: its dead reckoning and the motion up to it; accel [m/s2]: along the nose.
        """
        motion = self._correct_spin(motion, odometry.yaw, accel)
        self._tracker.update(t, replace(odometry, x=odometry.x - self._spin_offset[0],
                                        y=odometry.y - self._spin_offset[1]))
        try:
            self._filter.predict(*motion)
            lost = self._t is not None and t - self._t > motion.dt + MAX_MOTION_GAP
        except UsageError:  # impossible motion: the travel in that time is unknown
            lost = True
        if lost:
            self._frame = None
        self._t = t
        self._fuse_waiting()
        return self.estimate_at(t)

    def _correct_spin(self, motion: MotionStep, yaw: float, accel: float | None) -> MotionStep:
        """Replace the wheel speed by the integrated acceleration while the wheels spin."""
        ground = self._spin.update(motion.speed * motion.dt, motion.dt, accel,
                                   motion.yaw_rate * motion.dt)
        if ground is None:
            self._spin_error = 0.0
            return motion
        spun = (motion.speed - ground) * motion.dt
        before = self._spin_error
        x, y = self._spin_offset
        self._spin_offset = (x + spun * cos(yaw), y + spun * sin(yaw))
        self._spin_error = before + SPIN_SPEED_STD * motion.dt
        return motion._replace(speed=ground, speed_error=SPIN_SPEED_STD,
                               place_variance=self._spin_error**2 - before**2)

    def add(self, pose: ExternalPose) -> None:
        """Add a received pose."""
        outcome, t = self._tracker.add(pose)
        if outcome is PoseOutcome.FALSE_LOCK:
            self._waiting.clear()
            if self._t is not None:
                self._filter.forget(self._t - t)
        if outcome in (PoseOutcome.FALSE_LOCK, PoseOutcome.UNREACHABLE):
            # A track that has not moved yet may be locked from the start.
            if self._unconfirmed is not None:
                self._frame = None
        elif outcome is not PoseOutcome.OUTDATED:
            self._check_confirmed(outcome, pose)
            self._waiting.append(_AcceptedPose(t, pose, outcome is PoseOutcome.RELOCATED))
            self._fuse_waiting()

    def _check_confirmed(self, outcome: PoseOutcome, pose: ExternalPose) -> None:
        """Note whether the poses of this track have moved, as only those of the car do."""
        if outcome is PoseOutcome.FIRST:
            self._unconfirmed = pose
        elif (start := self._unconfirmed) is not None and (
                outcome is PoseOutcome.RELOCATED
                or hypot(pose.x - start.x, pose.y - start.y) > CONFIRMATION_DISTANCE):
            self._unconfirmed = None

    def estimate_at(self, t: float) -> External:
        """Return the external pose for the State at t [s], the newest given to ``update``."""
        external = self._tracker.estimate_at(t)
        if self._frame is None:
            return external
        motion = self._filter.estimate().motion(t, self._frame, external.tracking)
        if self._map_cov is None:
            return replace(external, estimate=motion)
        cov = motion.cov + self._map_cov
        cov.setflags(write=False)
        return replace(external, estimate=replace(
            motion, cov=cov, pose=replace(motion.pose, cov=cov[:3, :3])))

    @property
    def estimate(self) -> FilterEstimate:
        """Whole state of the filter; in the frame of the source only after the first pose."""
        return self._filter.estimate()

    def _fuse_waiting(self) -> None:
        """Fuse the accepted poses; a pose newer than the State waits for it."""
        now = self._t
        waiting = self._waiting
        while now is not None and waiting and waiting[0].t <= now:
            t, external, is_relocated = waiting.popleft()
            pose = Pose(external.x, external.y, external.yaw, external.cov)
            age = now - t
            if self._frame is None or is_relocated:
                self._start_filter(pose, age, external.frame)
            elif self._filter.correct(pose, age) is not PoseVerdict.OUTLIER:
                self._fused_t = t
            elif t - self._fused_t > MAX_OUTLIER_TIME:
                self._start_filter(pose, age, external.frame)

    def _start_filter(self, pose: Pose, age: float, frame: str) -> None:
        """Restart the filter at a pose; keep the old state if the pose is unusable."""
        try:
            self._filter.start(pose, age)
        except UsageError:  # too old, or no valid covariance: the next pose is tried
            return
        self._frame = frame
        if self._t is not None:
            self._fused_t = self._t - age
