"""Monitors every frame of a drive, and ends it at a limit or a fault."""

from __future__ import annotations

import math

import numpy as np

from dart_hal.core.errors import ExperimentFailed
from dart_hal.core.types import Doubt, Limit, Pose, State

from .floor import Fence
from .limits import RollingDistance, stays_inside

# [s] Longest throttle without an edge of the encoder.
MAX_NO_EDGE_TIME = 3.0
# Throttle that moves every car of this class.
MIN_PULL_THROTTLE = 0.2
# [m/s2] Change of the accelerometer's mean or spread that shows motion.
MIN_ACCEL_CHANGE = 0.3
# Factor and offset [m/s] of the top speed beyond which the drive ends.
OVERSPEED = (1.25, 0.25)
# [m], [rad] Largest offset from a lane, and angle to it.
MAX_LANE_OFFSET = 0.4
MAX_LANE_ANGLE = 0.6
# [s] Longest gap without a valid yaw rate.
MAX_GYRO_GAP = 0.5


class DriveStopped(Exception):
    """Ends the drive; its frames remain. The text is the reason."""


class DriveWatch:
    """Monitor of a drive: call ``look`` at every State with the commanded throttle.

    It raises DriveStopped at the fence and above the top speed, ExperimentFailed if the car, its
    encoder or its IMU does not respond correctly.
    """

    def __init__(self, fence: Fence, speed: float, rolling: RollingDistance) -> None:
        self._fence = fence
        self._speed = speed
        self._rolling = rolling
        self._ticks: int | None = None
        self._pulling: float | None = None
        self._blind: float | None = None
        self._still: list[float] = []
        self._driven: list[float] = []
        self._moved = False

    def look(self, state: State, pose: Pose, throttle: float, mode: str, causes: tuple[str, ...],
             lane: Pose | None = None) -> None:
        """Check one frame.

        pose: in the frame of the start; mode, causes: of the Car; lane: closest pose of the lane
        that is followed, None: the car would roll out along its present arc.
        """
        self._check_armed(mode, causes)
        self._check_motion(state, throttle)
        self._check_speed(state)
        self._check_imu(state)
        check_top_speed(state, self._speed)
        if lane is None:
            check_inside(state, pose, self._fence, self._rolling)
            return
        aside = math.hypot(pose.x - lane.x, pose.y - lane.y)
        if aside > MAX_LANE_OFFSET or abs(math.remainder(pose.yaw - lane.yaw,
                                                         2.0 * math.pi)) > MAX_LANE_ANGLE:
            raise DriveStopped(f"it left its lane: offset {aside:.2f} m at "
                               f"{state.speed:.2f} m/s")
        if not stays_inside(self._fence, lane, 0.0, self._rolling(state.speed)):
            raise _make_fence_stop(state, pose)

    def _check_armed(self, mode: str, causes: tuple[str, ...]) -> None:
        if mode == "ARMED":
            return
        raise ExperimentFailed(f"the car was stopped: it is {mode}",
                               found=", ".join(causes) or "a stop from outside",
                               expected="an armed car until the end",
                               remedy="dart-hal doctor; then the same command again")

    def _check_motion(self, state: State, throttle: float) -> None:
        moved = self._ticks is not None and state.ticks != self._ticks
        self._ticks = state.ticks
        self._moved = self._moved or moved
        if not self._moved and state.accel_x is not None:
            (self._driven if throttle > MIN_PULL_THROTTLE else self._still).append(state.accel_x)
        if moved or throttle < MIN_PULL_THROTTLE:
            self._pulling = None if moved else self._pulling
        elif self._pulling is None:
            self._pulling = state.t
        elif state.t - self._pulling > MAX_NO_EDGE_TIME:
            raise self._make_no_edge_error(state)

    def _check_speed(self, state: State) -> None:
        """End the drive if the measured speed cannot be that of the car."""
        if state.health.encoder_lost:
            raise self._make_no_edge_error(state)
        if state.health.speed_doubted:
            raise ExperimentFailed(
                "the encoder does not count what the car drives",
                found=f"{', '.join(sorted(state.health.doubts))} at {state.speed:.2f} m/s",
                expected="edges that fit throttle and accelerometer",
                likely="its sensor is too far from the ring, or the wheels lost their grip",
                remedy="turn a wheel by hand and watch dart-hal doctor")

    def _make_no_edge_error(self, state: State) -> ExperimentFailed:
        capped = Limit.RANGE.value in state.applied.limited
        found = "no edge of the encoder under a throttle that moves the car"
        if self._moved:
            return ExperimentFailed(
                "the encoder has fallen silent, or the car is blocked", found=found,
                expected="edges of the ring", likely="an obstacle blocks the car, the encoder's "
                "cable is loose, or the battery is empty", remedy="dart-hal doctor")
        if self._has_inertial_motion() or Doubt.ENCODER_LOW.value in state.health.doubts:
            return ExperimentFailed(
                "the car moves but its encoder does not count",
                found=f"{found}, but the accelerometer measures motion", expected="edges",
                likely="encoder unplugged, or its sensor too far from the ring",
                remedy="turn a wheel by hand and watch dart-hal doctor")
        return ExperimentFailed(
            "the car does not move", found=found + (
                "; the throttle was limited, as always without edges" if capped else ""),
            expected="motion at a throttle of about 0.25",
            likely="the ESC is off or has not armed (it needs 2 s of neutral after power-on), the "
                   "battery is empty, or the encoder is dead and the wheels are off the ground",
            remedy="switch the ESC on, put the car on the floor, run dart-hal doctor")

    def _has_inertial_motion(self) -> bool:
        if len(self._still) < 20 or len(self._driven) < 20:
            return False
        rest = np.array(self._still)
        driven = np.array(self._driven)
        # Without edges the throttle is cut again and again: the car speeds up and slows down.
        return bool(abs(driven.mean() - rest.mean()) > MIN_ACCEL_CHANGE or driven.std() > rest.std()
                    + MIN_ACCEL_CHANGE)

    def _check_imu(self, state: State) -> None:
        if state.yaw_rate is not None and state.health.imu_age < 0.2:
            self._blind = None
        elif self._blind is None:
            self._blind = state.t
        elif state.t - self._blind > MAX_GYRO_GAP:
            raise ExperimentFailed("no yaw rate while driving", found="IMU not valid",
                                   expected="100 Hz of gyro data", likely="IMU unplugged, or "
                                   "reset by a voltage drop", remedy="dart-hal doctor")


def check_top_speed(state: State, speed: float) -> None:
    """Raise DriveStopped well above the top speed [m/s]."""
    if abs(state.speed) > OVERSPEED[0] * speed + OVERSPEED[1]:
        raise DriveStopped(f"{state.speed:.2f} m/s with a top speed of {speed:.2f} m/s")


def check_inside(state: State, pose: Pose, fence: Fence, rolling: RollingDistance) -> None:
    """Raise DriveStopped if the car, without throttle from now on, would leave the fence."""
    curvature = 0.0
    if state.yaw_rate is not None and abs(state.speed) > 0.2:
        curvature = state.yaw_rate / state.speed
    if not stays_inside(fence, pose, curvature, rolling(state.speed)):
        raise _make_fence_stop(state, pose)


def _make_fence_stop(state: State, pose: Pose) -> DriveStopped:
    return DriveStopped(f"it would have left the floor: {state.speed:.2f} m/s at x {pose.x:.2f} m, "
                        f"y {pose.y:.2f} m from its start")


def in_frame(pose: Pose, start: Pose) -> Pose:
    """Return the pose relative to ``start``: x ahead, y to the left, yaw from its heading."""
    dx, dy = pose.x - start.x, pose.y - start.y
    c, s = math.cos(start.yaw), math.sin(start.yaw)
    return Pose(c * dx + s * dy, c * dy - s * dx, pose.yaw - start.yaw)
