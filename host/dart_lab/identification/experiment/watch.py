"""Looks at every frame of a drive and says when it must end, and why."""

from __future__ import annotations

import math

import numpy as np

from dart_hal.core.errors import ExperimentFailed
from dart_hal.core.types import Doubt, Limit, Pose, State

from .floor import Fence
from .limits import Rolling, stays_inside

NO_MOTION = 3.0
"""s of throttle without an edge of the encoder until the drive gives up."""
PULLS = 0.2
"""Throttle that every car of this class feels."""
FELT = 0.3
"""m/s2 by which the accelerometer's mean or spread must change to say: it moves."""
OVER = (1.25, 0.25)
"""Share and m/s by which the top speed may be passed before the drive is ended."""
ASIDE, ASKEW = 0.4, 0.6
"""m beside a lane and rad off its heading until the car has lost it."""
MOST_LOST = 0.5
"""s without a valid yaw rate until the odometry is given up."""


class Stopped(Exception):
    """The drive has to end here, what was driven is kept; the text says why."""


class Watch:
    """Call ``look`` at every State with the throttle that is asked for.

    Raises Stopped at the fence and above the top speed, ExperimentFailed when
    the car, its encoder or its IMU does not answer as it should.
    """

    def __init__(self, fence: Fence, speed: float, rolling: Rolling) -> None:
        self._fence, self._speed, self._rolling = fence, speed, rolling
        self._ticks: int | None = None
        self._pulling: float | None = None
        self._blind: float | None = None
        self._still: list[float] = []
        self._driven: list[float] = []
        self._moved = False

    def look(self, state: State, pose: Pose, throttle: float, mode: str, causes: tuple[str, ...],
             lane: Pose | None = None) -> None:
        """pose: in the frame of the start. mode, causes: the Car's. lane: its nearest point,
        where one is kept; else the car is taken to roll on along its present arc.
        """
        self._armed(mode, causes)
        self._motion(state, throttle)
        self._doubted(state)
        self._imu(state)
        too_fast(state, self._speed)
        if lane is None:
            still_inside(state, pose, self._fence, self._rolling)
            return
        aside = math.hypot(pose.x - lane.x, pose.y - lane.y)
        if aside > ASIDE or abs(math.remainder(pose.yaw - lane.yaw, 2.0 * math.pi)) > ASKEW:
            raise Stopped(f"it left its lane: {aside:.2f} m off at "
                          f"{state.speed:.2f} m/s")
        if not stays_inside(self._fence, lane, 0.0, self._rolling(state.speed)):
            raise _leaves(state, pose)

    def _armed(self, mode: str, causes: tuple[str, ...]) -> None:
        if mode == "ARMED":
            return
        raise ExperimentFailed(f"the car was stopped: it is {mode}",
                               found=", ".join(causes) or "somebody stopped it",
                               expected="an armed car until the end",
                               remedy="dart-hal doctor; then the same command again")

    def _motion(self, state: State, throttle: float) -> None:
        moved = self._ticks is not None and state.ticks != self._ticks
        self._ticks = state.ticks
        self._moved = self._moved or moved
        if not self._moved and state.accel_x is not None:
            (self._driven if throttle > PULLS else self._still).append(state.accel_x)
        if moved or throttle < PULLS:
            self._pulling = None if moved else self._pulling
        elif self._pulling is None:
            self._pulling = state.t
        elif state.t - self._pulling > NO_MOTION:
            raise self._stands(state)

    def _doubted(self, state: State) -> None:
        """A speed that is not the car's ends the drive at once."""
        if state.health.encoder_lost:
            raise self._stands(state)
        if state.health.speed_doubted:
            raise ExperimentFailed(
                "the encoder does not count what the car drives",
                found=f"{', '.join(sorted(state.health.doubts))} at {state.speed:.2f} m/s",
                expected="edges that fit throttle and accelerometer",
                likely="its sensor is too far from the ring, or the wheels lost their grip",
                remedy="turn a wheel by hand and watch dart-hal doctor")

    def _stands(self, state: State) -> ExperimentFailed:
        capped = Limit.RANGE.value in state.applied.limited
        seen = "no edge of the encoder under a throttle that moves the car"
        if self._moved:
            return ExperimentFailed(
                "the encoder has fallen silent, or the car is held", found=seen,
                expected="edges of the ring", likely="it stands against something, its cable "
                "is loose, or the battery is empty", remedy="dart-hal doctor")
        if self._feels_motion() or Doubt.ENCODER_LOW.value in state.health.doubts:
            return ExperimentFailed(
                "the car moves but its encoder does not count",
                found=f"{seen}, though the accelerometer feels motion", expected="edges",
                likely="encoder unplugged, or its sensor too far from the ring",
                remedy="turn a wheel by hand and watch dart-hal doctor")
        return ExperimentFailed(
            "the car does not move", found=seen + (
                "; the throttle was cut meanwhile, as always without edges" if capped else ""),
            expected="motion at a throttle of about 0.25",
            likely="the ESC is off or has not armed (it needs 2 s of neutral after power-on), the "
                   "battery is empty, or the encoder is dead and the wheels are off the ground",
            remedy="switch the ESC on, put the car on the floor, run dart-hal doctor")

    def _feels_motion(self) -> bool:
        if len(self._still) < 20 or len(self._driven) < 20:
            return False
        rest, driven = np.array(self._still), np.array(self._driven)
        # a car that is let go again and again (no edge: no throttle) speeds up and slows down
        return bool(abs(driven.mean() - rest.mean()) > FELT or driven.std() > rest.std() + FELT)

    def _imu(self, state: State) -> None:
        if state.yaw_rate is not None and state.health.imu_age < 0.2:
            self._blind = None
        elif self._blind is None:
            self._blind = state.t
        elif state.t - self._blind > MOST_LOST:
            raise ExperimentFailed("no yaw rate while driving", found="IMU not valid",
                                   expected="100 Hz of gyro data", likely="IMU unplugged, or "
                                   "reset by a voltage drop", remedy="dart-hal doctor")


def too_fast(state: State, speed: float) -> None:
    """Raises Stopped well above the top speed [m/s]."""
    if abs(state.speed) > OVER[0] * speed + OVER[1]:
        raise Stopped(f"{state.speed:.2f} m/s with a top speed of {speed:.2f} m/s")


def still_inside(state: State, pose: Pose, fence: Fence, rolling: Rolling) -> None:
    """Raises Stopped when the car, let go now, would roll out of the fence on its arc."""
    curvature = 0.0
    if state.yaw_rate is not None and abs(state.speed) > 0.2:
        curvature = state.yaw_rate / state.speed
    if not stays_inside(fence, pose, curvature, rolling(state.speed)):
        raise _leaves(state, pose)


def _leaves(state: State, pose: Pose) -> Stopped:
    return Stopped(f"it would have left the floor: {state.speed:.2f} m/s at x {pose.x:.2f} m, "
                   f"y {pose.y:.2f} m from its start")


def in_frame(pose: Pose, start: Pose) -> Pose:
    """The pose seen from ``start``: x ahead, y to the left, yaw from its heading."""
    dx, dy = pose.x - start.x, pose.y - start.y
    c, s = math.cos(start.yaw), math.sin(start.yaw)
    return Pose(c * dx + s * dy, c * dy - s * dx, pose.yaw - start.yaw)
