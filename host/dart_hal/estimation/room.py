"""Where the rear axle is in the room: which poses to believe, and what they make of the motion.

``PoseTracker`` says which external poses are those of this car; ``PoseFilter`` fuses them with
wheels and gyro. Marker and latency are learnt on the way, from what a calibration says of them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from math import cos, hypot, sin
from typing import NamedTuple

from dart_hal.core.errors import UsageError
from dart_hal.core.types import External, ExternalPose, Pose
from dart_hal.estimation.odometry import Motion, Odometry
from dart_hal.estimation.pose_filter import Estimate, PoseFilter, Verdict
from dart_hal.estimation.pose_model import Marker
from dart_hal.estimation.pose_tracking import CONFIRMED, MARKER, MARKER_YAW, PoseTracker, Taken
from dart_hal.estimation.spin import LOOSE, Spin

UNKNOWN = Marker(latency=0.01, std=(MARKER, MARKER, MARKER_YAW, 0.02))
"""A source of which nothing is known: optical systems are 3 to 15 ms late, 40 to 60 over a
network; what the fit of its clock already took off is the least of it."""
SLIDES, SLIDES_STD = 0.0225, 0.016
"""rad per m/s2, slip gain of the rear tyres and one sigma: 0.011 and 0.034 of the two published
sets (``odometry.py``). At constant speed v nothing tells it from lx: 0.01 are 1 cm at 1 m/s."""
ASTRAY = 0.5
"""s of poses that the track believes and the filter does not, until it begins anew."""
GAP = 0.1
"""s by which the State's time may outrun the motions; more was lost in a reset of the Nano."""


class _Fix(NamedTuple):
    """A believed pose and the time [s] of its measurement; anew: the track begins there."""

    t: float
    seen: ExternalPose
    anew: bool


class RoomEstimator:
    """One per open car with a source: ``moved`` for each State, ``add`` for each pose.

    odometry: the car's, for what it knows of its sensors when it is opened; own_clock: stamps
    are on the car's clock.
    """

    def __init__(self, odometry: Odometry, marker: Marker = UNKNOWN, *,
                 own_clock: bool = False) -> None:
        self._tracker = PoseTracker(own_clock=own_clock)
        self._late, marker = marker.latency, marker._replace(latency=0.0)
        self._filter = PoseFilter(
            replace(odometry.noise, slip_gain=SLIDES_STD), slip_gain=SLIDES,
            gyro_bias=odometry.bias.value, gyro_bias_std=odometry.bias.std, marker=marker)
        self._waiting: deque[_Fix] = deque()
        self._t: float | None = None
        self._frame: str | None = None
        """Of the room; None while the filter knows no place in it."""
        self._fused_t = 0.0
        self._first: ExternalPose | None = None
        """Where the track began, until poses have moved from there as the car did."""
        self._spin, self._spun, self._loose = Spin(), (0.0, 0.0), 0.0
        """Spun: m, in the axes of the dead reckoning, that the wheels turned and the car did not
        go; loose: m that it may have gone since it spins."""

    def moved(self, t: float, odometry: Pose, motion: Motion, accel: float | None = None
              ) -> External:
        """The State at t [s], its dead reckoning and the motion up to it; accel [m/s2] along the
        nose."""
        motion = self._on_ground(motion, odometry.yaw, accel)
        self._tracker.moved(t, replace(odometry, x=odometry.x - self._spun[0],
                                       y=odometry.y - self._spun[1]))
        try:
            self._filter.predict(*motion)
            lost = self._t is not None and t - self._t > motion.dt + GAP
        except UsageError:  # no car drives so: what it did in that time is not known
            lost = True
        if lost:
            self._frame = None
        self._t = t
        self._fuse()
        return self.at(t)

    def _on_ground(self, motion: Motion, yaw: float, accel: float | None) -> Motion:
        """What the car did, where its wheels part from what the accelerometer feels."""
        ground = self._spin.moved(motion.speed * motion.dt, motion.dt, accel,
                                  motion.yaw_rate * motion.dt)
        if ground is None:
            self._loose = 0.0
            return motion
        spun, before = (motion.speed - ground) * motion.dt, self._loose
        self._spun = self._spun[0] + spun * cos(yaw), self._spun[1] + spun * sin(yaw)
        self._loose = before + LOOSE * motion.dt
        return motion._replace(speed=ground, missed=LOOSE,
                               place_variance=self._loose**2 - before**2)

    def add(self, pose: ExternalPose) -> None:
        """A pose that has arrived."""
        taken, t = self._tracker.add(pose)
        t -= self._late
        if taken is Taken.FOOLED:
            self._waiting.clear()
            if self._t is not None:
                self._filter.forget(self._t - t)
        if taken in (Taken.FOOLED, Taken.REFUSED):
            if self._first is not None:  # it has never been seen to move: locked from the first?
                self._frame = None
        elif taken is not Taken.OLD:
            self._confirm(taken, pose)
            self._waiting.append(_Fix(t, pose, taken is Taken.ANEW))
            self._fuse()

    def _confirm(self, taken: Taken, pose: ExternalPose) -> None:
        """Note whether the poses of this track have moved, which only the car's do."""
        if taken is Taken.FIRST:
            self._first = pose
        elif self._first is not None and (taken is Taken.ANEW or hypot(
                pose.x - self._first.x, pose.y - self._first.y) > CONFIRMED):
            self._first = None

    def at(self, t: float) -> External:
        """What is known for the State at t [s], the newest that was ``moved``."""
        told = self._tracker.at(t)
        if self._frame is None:
            return told
        return replace(told, estimate=self._filter.estimate().motion(t, self._frame, told.tracking))

    @property
    def estimate(self) -> Estimate:
        """The whole state of the filter; of the room only after the first pose."""
        return self._filter.estimate()

    def _fuse(self) -> None:
        """Give the filter what the track believes; a pose newer than the State waits for it."""
        now, waiting = self._t, self._waiting
        while now is not None and waiting and waiting[0].t <= now:
            t, seen, anew = waiting.popleft()
            pose, age = Pose(seen.x, seen.y, seen.yaw, seen.cov), now - t
            if self._frame is None or anew:
                self._begin(pose, age, seen.frame)
            elif self._filter.correct(pose, age) is not Verdict.OUTLIER:
                self._fused_t = t
            elif t - self._fused_t > ASTRAY:
                self._begin(pose, age, seen.frame)

    def _begin(self, pose: Pose, age: float, frame: str) -> None:
        try:
            self._filter.start(pose, age)
        except UsageError:  # too late, or no covariance: the next one then
            return
        self._frame = frame
        if self._t is not None:
            self._fused_t = self._t - age
