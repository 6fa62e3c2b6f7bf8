"""Pose by wheels, gyro and delayed external poses: an extended Kalman filter.

Motions and poses of the last ``FILTER_HISTORY`` seconds are stored in order of time. A pose that
was measured ``age`` s ago is inserted at its time, and all later steps are repeated, also when
poses arrive out of order. A pose beyond the chi-square gate is not fused. It is gated once, when it
arrives, by the poses known then: this alone can depend on the order of arrival.
``pose_tracking``, which selects the poses of a car, passes them in the order of their stamps.

Dead reckoning (``odometry.py``) runs in parallel and is the input: ``Odometry.update`` returns the
``MotionStep`` that ``predict`` takes, ``filter.predict(*motion)``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from dart_hal.compat import accept_old_keyword
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, MotionEstimate, Pose, Tracking
from dart_hal.estimation.odometry import MotionStep, OdometryNoise
from dart_hal.estimation.pose_model import (
    BIAS,
    CHI2_3,
    MIN_POSE_STD,
    RATE,
    SPEED,
    FilterState,
    MarkerModel,
    initial_state,
    place_at_pose,
    predict_motion,
    squared_distance,
    update_with_pose,
)

# s of delay that a pose may have: several times the 40 to 60 ms of motion capture over a network.
FILTER_HISTORY = 0.5
# m/s. A larger value is no measurement: the car does 5 m/s.
MAX_SPEED = 20.0
# rad/s: the gyro shows at most 35 rad/s.
MAX_YAW_RATE = 50.0
# s without a frame after which the position is unknown: start again.
MAX_FRAME_GAP = 10.0
# s: two ticks of the clock of the Nano; nothing happens in less.
MIN_STEP = 1e-6


class PoseVerdict(str, Enum):
    """Result of ``PoseFilter.correct``."""

    FUSED = "fused"
    OUTLIER = "outlier"
    TOO_OLD = "too old"
    UNUSABLE = "unusable"


@dataclass(frozen=True, slots=True)
class FilterEstimate:
    """mean (13,), cov (13, 13) in the order and the units of ``pose_model``; read-only."""

    mean: FloatArray
    cov: FloatArray

    @property
    def pose(self) -> Pose:
        """Pose with its covariance (3, 3)."""
        x, y, yaw = self.mean[:SPEED].tolist()
        return Pose(x, y, yaw, self.cov[:SPEED, :SPEED])

    def motion(self, t: float, frame: str, tracking: Tracking) -> MotionEstimate:
        """Return the estimate as part of a State, for its time t [s]."""
        cov = self.cov[:BIAS, :BIAS]
        return MotionEstimate(t, self.pose, float(self.mean[SPEED]), float(self.mean[RATE]), cov,
                              frame, tracking)


class _MeasuredPose(NamedTuple):
    """Pose (3,) of the marker and its covariance (3, 3)."""
    pose: FloatArray
    cov: FloatArray


class _Step(NamedTuple):
    """An event, the time t [s] at its end, and the state after it."""

    t: float
    event: MotionStep | _MeasuredPose | None
    state: FilterState


class PoseFilter:
    """One per car: ``predict`` for each frame, ``correct`` for each external pose.

    Starts at the origin like dead reckoning; call ``start`` at the first external pose, and after
    the track was lost.

    gyro_bias [rad/s] and its one sigma: of the calibration, if there is one; slip_gain
    [rad per m/s2]: of the rear tyres; marker: where poses are measured, by default at the rear
    axle and without latency.
    """

    def __init__(self, noise: OdometryNoise | None = None, *, gyro_bias: float = 0.0,
                 gyro_bias_std: float | None = None, slip_gain: float = 0.0,
                 marker: MarkerModel | None = None) -> None:
        self._noise = n = noise or OdometryNoise()
        std = n.gyro_bias if gyro_bias_std is None else gyro_bias_std
        start = initial_state(n, gyro_bias, std, slip_gain, marker or MarkerModel())
        self._steps = [_Step(0.0, None, start)]
        # Consecutive outliers; the caller decides when the track is lost and starts again.
        self.outliers = 0

    def start(self, pose: Pose, age: float = 0.0) -> None:
        """Restart at a pose of ``age`` s ago, possibly in another frame.

        The estimated errors of the sensors are kept, without their correlation to the old pose.
        Raises UsageError for a pose that ``correct`` would not accept.
        """
        measured = _validate_pose(pose)
        t = self._steps[-1].t - age
        if measured is None or not self._steps[0].t <= t <= self._steps[-1].t:
            raise UsageError(f"{pose} of {age:g} s ago", expected="finite x, y, yaw, a positive "
                             f"definite cov (3, 3), at most {FILTER_HISTORY:g} s late")
        before, after = self._split_at(t)
        self._steps = [_Step(t, None, place_at_pose(before[-1].state, *measured))]
        self._steps += self._replay(self._steps[0],
                                    [event for event in after if isinstance(event, MotionStep)])
        self.outliers = 0

    def predict(self, dt: float, speed: float, yaw_rate: float, yaw_variance: float = 0.0,
                gyro: bool = True, at_rest: bool = False, speed_error: float = 0.0,
                place_variance: float = 0.0, yaw_acceleration: float = 0.0) -> None:
        """Advance by ``dt`` s; the arguments are those of ``MotionStep``. Ignored below MIN_STEP.

        Raises UsageError, and changes nothing, for values that no car reaches.
        """
        motion = MotionStep(dt, speed, yaw_rate, yaw_variance, gyro, at_rest, speed_error,
                            place_variance, yaw_acceleration)
        if not (all(map(isfinite, motion)) and abs(speed) <= MAX_SPEED
                and abs(yaw_rate) <= MAX_YAW_RATE and dt <= MAX_FRAME_GAP
                and 0.0 <= yaw_variance <= (MAX_YAW_RATE * MAX_FRAME_GAP)**2
                and 0.0 <= speed_error <= MAX_SPEED and place_variance >= 0.0):
            raise UsageError(f"{motion}", expected=f"finite numbers, at most {MAX_SPEED:g} m/s, "
                             f"{MAX_YAW_RATE:g} rad/s and {MAX_FRAME_GAP:g} s")
        if dt < MIN_STEP:
            return
        last = self._steps[-1]
        now = last.t + dt
        self._steps.append(_Step(now, motion, predict_motion(last.state, motion, self._noise)))
        while len(self._steps) > 1 and self._steps[1].t <= now - FILTER_HISTORY:
            del self._steps[0]

    def correct(self, pose: Pose, age: float) -> PoseVerdict:
        """Fuse a pose of the marker that was measured ``age`` s before the last ``predict``."""
        measured = _validate_pose(pose)
        if measured is None or not 0.0 <= age < inf:
            return PoseVerdict.UNUSABLE
        t = self._steps[-1].t - age
        if t < self._steps[0].t:
            return PoseVerdict.TOO_OLD
        before, after = self._split_at(t)
        if squared_distance(before[-1].state, *measured) > CHI2_3:
            self.outliers += 1
            return PoseVerdict.OUTLIER
        self.outliers = 0
        self._steps = before + self._replay(before[-1], [measured, *after])
        return PoseVerdict.FUSED

    def forget(self, age: float) -> None:
        """Remove the poses of the last ``age`` s: they were not of this car."""
        t = max(self._steps[-1].t - age, self._steps[0].t)
        before, after = self._split_at(t)
        self._steps = before + self._replay(
            before[-1], [event for event in after if isinstance(event, MotionStep)])

    @accept_old_keyword("ahead", "horizon")
    def estimate(self, horizon: float = 0.0) -> FilterEstimate:
        """Return the estimate for the time of the last ``predict``, or ``horizon`` s later.

        The last motion is then extrapolated, for FILTER_HISTORY s at most.
        """
        last = next((step.event for step in reversed(self._steps)
                     if isinstance(step.event, MotionStep)), None)
        state = self._steps[-1].state
        if last is not None and horizon > 0.0:
            motion = last._replace(dt=min(horizon, FILTER_HISTORY))
            state = predict_motion(state, motion, self._noise)
        for array in (state.mean, state.cov):
            array.setflags(write=False)
        return FilterEstimate(state.mean, state.cov)

    def _split_at(self, t: float) -> tuple[list[_Step], list[MotionStep | _MeasuredPose | None]]:
        """Return the steps up to time t [s], the last motion cut there, and the events after it."""
        before = [step for step in self._steps if step.t <= t + MIN_STEP]
        after = [step.event for step in self._steps[len(before):]]
        part = t - before[-1].t
        if after and isinstance(motion := after[0], MotionStep) and part > MIN_STEP:
            yaw_variance_rate = motion.yaw_variance / motion.dt
            place_variance_rate = motion.place_variance / motion.dt
            first, rest = (motion._replace(dt=dt, yaw_variance=yaw_variance_rate * dt,
                                           place_variance=place_variance_rate * dt)
                           for dt in (part, motion.dt - part))
            before += self._replay(before[-1], [first])
            after[0] = rest
        return before, after

    def _replay(self, start: _Step, events: Iterable[MotionStep | _MeasuredPose | None]
                ) -> list[_Step]:
        """Apply events to ``start``; return the new steps."""
        steps = [start]
        for event in events:
            t, _, state = steps[-1]
            if isinstance(event, MotionStep):
                steps.append(_Step(t + event.dt, event, predict_motion(state, event, self._noise)))
            elif event is not None:
                steps.append(_Step(t, event, update_with_pose(state, *event)))
        return steps[1:]


def _validate_pose(pose: Pose) -> _MeasuredPose | None:
    """Return the values of a pose if they are finite and its covariance is positive definite."""
    values = np.array((pose.x, pose.y, pose.yaw))
    cov = np.asarray(pose.cov, dtype=float)
    if cov.shape != (3, 3) or not (np.isfinite(values).all() and np.isfinite(cov).all()):
        return None
    if not np.allclose(cov, cov.T, rtol=1e-6, atol=0.0) or (np.diag(cov) <= 0.0).any():
        return None
    std = np.sqrt(np.diag(cov))
    if np.linalg.eigvalsh(cov / std / std[:, None])[0] <= 0.0:
        return None
    cov = 0.5 * (cov + cov.T)
    cov[np.diag_indices(3)] += MIN_POSE_STD**2
    return _MeasuredPose(values, cov)
