"""The pose by wheels, gyro and external poses that arrive late: an extended Kalman filter.

Motions and poses of the last ``HISTORY`` seconds are kept in order of time. A pose that was
measured ``age`` s ago is put in where it belongs, and what came after is done again: exact, also
when poses arrive out of order. A pose further off than chi-square allows is not fused.

Dead reckoning (``odometry.py``) goes on beside it and feeds it: ``Odometry.update`` returns the
``Motion`` that ``predict`` takes, ``filter.predict(*motion)``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, MotionEstimate, Pose, Tracking
from dart_hal.estimation.odometry import Motion, OdometryNoise
from dart_hal.estimation.pose_model import (
    BIAS,
    CHI2_3,
    FINEST,
    RATE,
    SPEED,
    Belief,
    Marker,
    distance2,
    fused,
    moved,
    placed,
    started,
)

HISTORY = 0.5
"""s that a pose may be late: several times the 40 to 60 ms of motion capture over a network."""
FASTEST, QUICKEST = 20.0, 50.0
"""m/s, rad/s: faster is no measurement; the car does 5 m/s, the gyro shows 35 rad/s at most."""
LONGEST = 10.0
"""s without a frame after which nobody can say where the car is: begin anew."""
SHORTEST = 1e-6
"""s: two ticks of the Nano's clock; nothing happens in less."""


class Verdict(str, Enum):
    """What became of an external pose."""

    FUSED = "fused"
    OUTLIER = "outlier"
    TOO_OLD = "too old"
    UNUSABLE = "unusable"


@dataclass(frozen=True, slots=True)
class Estimate:
    """mean (13,), cov (13, 13) in the order and the units of ``pose_model``; read-only."""

    mean: FloatArray
    cov: FloatArray

    @property
    def pose(self) -> Pose:
        x, y, yaw = self.mean[:SPEED].tolist()
        return Pose(x, y, yaw, self.cov[:SPEED, :SPEED])

    def motion(self, t: float, frame: str, tracking: Tracking) -> MotionEstimate:
        """As a State tells it, for its time t [s]."""
        cov = self.cov[:BIAS, :BIAS]
        return MotionEstimate(t, self.pose, float(self.mean[SPEED]), float(self.mean[RATE]), cov,
                              frame, tracking)


class _Seen(NamedTuple):
    pose: FloatArray
    cov: FloatArray


class _Step(NamedTuple):
    """What happened up to time t [s], and what is believed after it."""

    t: float
    event: Motion | _Seen | None
    belief: Belief


class PoseFilter:
    """One per car: ``predict`` for each frame, ``correct`` for each external pose.

    Begins at the origin like dead reckoning; ``start`` at the first external pose, and where the
    track was lost.

    gyro_bias [rad/s] and its one sigma: of the calibration, if there is one; slip_gain
    [rad per m/s2]: of the rear tyres; marker: where poses are measured, by default at the rear
    axle and at the time that is said.
    """

    def __init__(self, noise: OdometryNoise | None = None, *, gyro_bias: float = 0.0,
                 gyro_bias_std: float | None = None, slip_gain: float = 0.0,
                 marker: Marker | None = None) -> None:
        self._noise = n = noise or OdometryNoise()
        std = n.gyro_bias if gyro_bias_std is None else gyro_bias_std
        self._steps = [_Step(0.0, None, started(n, gyro_bias, std, slip_gain, marker or Marker()))]
        self.outliers = 0
        """Outliers in a row; the caller decides when the track is lost and begins anew."""

    def start(self, pose: Pose, age: float = 0.0) -> None:
        """Begin anew at a pose of ``age`` s ago, in another frame maybe.

        What was learnt of the sensors is kept, without its correlation to the old pose. Raises
        UsageError for a pose that ``correct`` would not take.
        """
        seen, t = _usable(pose), self._steps[-1].t - age
        if seen is None or not self._steps[0].t <= t <= self._steps[-1].t:
            raise UsageError(f"{pose} of {age:g} s ago", expected="finite x, y, yaw, a positive "
                             f"definite cov (3, 3), at most {HISTORY:g} s late")
        before, after = self._split(t)
        self._steps = [_Step(t, None, placed(before[-1].belief, *seen))]
        self._steps += self._again(self._steps[0],
                                   [event for event in after if isinstance(event, Motion)])
        self.outliers = 0

    def predict(self, dt: float, speed: float, yaw_rate: float, yaw_variance: float = 0.0,
                gyro: bool = True, standing: bool = False, missed: float = 0.0,
                place_variance: float = 0.0) -> None:
        """The next ``dt`` s; the arguments are those of ``Motion``, nothing happens below SHORTEST.

        Raises UsageError, and changes nothing, for numbers that no car drives.
        """
        motion = Motion(dt, speed, yaw_rate, yaw_variance, gyro, standing, missed, place_variance)
        if not (all(map(isfinite, motion)) and abs(speed) <= FASTEST and abs(yaw_rate) <= QUICKEST
                and dt <= LONGEST and 0.0 <= yaw_variance <= (QUICKEST * LONGEST)**2
                and 0.0 <= missed <= FASTEST and place_variance >= 0.0):
            raise UsageError(f"{motion}", expected=f"finite numbers, at most {FASTEST:g} m/s, "
                             f"{QUICKEST:g} rad/s and {LONGEST:g} s")
        if dt < SHORTEST:
            return
        last = self._steps[-1]
        now = last.t + dt
        self._steps.append(_Step(now, motion, moved(last.belief, motion, self._noise)))
        while len(self._steps) > 1 and self._steps[1].t <= now - HISTORY:
            del self._steps[0]

    def correct(self, pose: Pose, age: float) -> Verdict:
        """Fuse a pose of the marker that was measured ``age`` s before the last ``predict``."""
        seen = _usable(pose)
        if seen is None or not 0.0 <= age < inf:
            return Verdict.UNUSABLE
        t = self._steps[-1].t - age
        if t < self._steps[0].t:
            return Verdict.TOO_OLD
        before, after = self._split(t)
        if distance2(before[-1].belief, *seen) > CHI2_3:
            self.outliers += 1
            return Verdict.OUTLIER
        self.outliers = 0
        self._steps = before + self._again(before[-1], [seen, *after])
        return Verdict.FUSED

    def forget(self, age: float) -> None:
        """Undo the poses of the last ``age`` s: they were of something else."""
        t = max(self._steps[-1].t - age, self._steps[0].t)
        before, after = self._split(t)
        self._steps = before + self._again(
            before[-1], [event for event in after if isinstance(event, Motion)])

    def estimate(self, ahead: float = 0.0) -> Estimate:
        """What is believed of the time of the last ``predict``, or ``ahead`` s later if the car
        goes on as it did, for HISTORY s at most."""
        last = next((step.event for step in reversed(self._steps)
                     if isinstance(step.event, Motion)), None)
        belief = self._steps[-1].belief
        if last is not None and ahead > 0.0:
            belief = moved(belief, last._replace(dt=min(ahead, HISTORY)), self._noise)
        for array in (belief.mean, belief.cov):
            array.setflags(write=False)
        return Estimate(belief.mean, belief.cov)

    def _split(self, t: float) -> tuple[list[_Step], list[Motion | _Seen | None]]:
        """Steps up to time t [s], the last motion cut there, and the events after it."""
        before = [step for step in self._steps if step.t <= t + SHORTEST]
        after = [step.event for step in self._steps[len(before):]]
        part = t - before[-1].t
        if after and isinstance(motion := after[0], Motion) and part > SHORTEST:
            turn, place = motion.yaw_variance / motion.dt, motion.place_variance / motion.dt
            first, rest = (motion._replace(dt=dt, yaw_variance=turn * dt, place_variance=place * dt)
                           for dt in (part, motion.dt - part))
            before += self._again(before[-1], [first])
            after[0] = rest
        return before, after

    def _again(self, start: _Step, events: Iterable[Motion | _Seen | None]) -> list[_Step]:
        """The steps that events make of ``start``, without it."""
        steps = [start]
        for event in events:
            t, _, belief = steps[-1]
            if isinstance(event, Motion):
                steps.append(_Step(t + event.dt, event, moved(belief, event, self._noise)))
            elif event is not None:
                steps.append(_Step(t, event, fused(belief, *event)))
        return steps[1:]


def _usable(pose: Pose) -> _Seen | None:
    """The numbers of a pose, if they are finite and its covariance is one."""
    values, cov = np.array((pose.x, pose.y, pose.yaw)), np.asarray(pose.cov, dtype=float)
    if cov.shape != (3, 3) or not (np.isfinite(values).all() and np.isfinite(cov).all()):
        return None
    if not np.allclose(cov, cov.T, rtol=1e-6, atol=0.0) or (np.diag(cov) <= 0.0).any():
        return None
    std = np.sqrt(np.diag(cov))
    if np.linalg.eigvalsh(cov / std / std[:, None])[0] <= 0.0:
        return None
    cov = 0.5 * (cov + cov.T)
    cov[np.diag_indices(3)] += FINEST**2
    return _Seen(values, cov)
