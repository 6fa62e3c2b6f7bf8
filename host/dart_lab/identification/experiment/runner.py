"""Drives a plan on a Car, one command for each frame of the telemetry."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

from dart_hal.control.speed import SpeedLaw
from dart_hal.core.config import CarFiles
from dart_hal.core.types import Applied, Pose, State
from dart_hal.devices.actuation.quantiser import counter_of
from dart_hal.devices.actuation.steering_map import steering_map
from dart_hal.vehicle.load import vehicle_of

from .excitation import Ramp
from .limits import RollingDistance
from .plans import ExperimentPlan, Segment
from .watch import DriveStopped, DriveWatch, in_frame

SOURCE = "experiment"
# Limit of the speed loop: slow driving needs 0.25; more means that the speed is not measured.
MAX_THROTTLE = 0.4
# [s] The car is at rest if there was no edge for that time.
STANDSTILL_DELAY = 0.2
# [rad] Error of a whole turn: about one step of 50 ms on the tightest circle.
HEADING_TOLERANCE = 0.06
# [s] Time constant of the mean throttle of the speed loop, for a relative throttle.
THROTTLE_MEAN_TIME = 1.0

Progress = Callable[[float, str], None]


class ExperimentCar(Protocol):
    """Interface of a Car that a drive needs."""

    files: CarFiles

    def states(self, *, duration: float = ..., timeout: float = ...) -> Iterator[State]: ...
    def drive(self, *, steering: float = ..., throttle: float = ..., valid_for: float = ...,
              source: str = ...) -> Applied: ...
    def stop(self) -> object: ...
    @property
    def mode(self) -> str: ...
    @property
    def causes(self) -> tuple[str, ...]: ...


@dataclass(frozen=True, slots=True)
class DriveFrame:
    """One frame of a drive: t [s] from its start, pose in the frame of the start, command."""

    t: float
    pose: Pose
    speed: float
    throttle: float
    steering: float
    segment: str
    measured: bool


@dataclass(frozen=True, slots=True)
class ExperimentDrive:
    """Frames of a drive; stopped: why it ended early, "" = it did not."""

    plan: ExperimentPlan
    frames: tuple[DriveFrame, ...]
    stopped: str = ""


class ExperimentRunner:
    """Drives one plan on an armed ``car``, and stops it at the end."""

    def __init__(self, car: ExperimentCar, plan: ExperimentPlan) -> None:
        files = car.files
        vehicle = vehicle_of(files.model)
        self._car = car
        self._plan = plan
        self._track = plan.track()
        self._wheelbase = files.config.geometry.wheelbase
        table = files.calibration.steering.map if files.calibration else None
        self._map = steering_map(files.config, table)
        self._rolling = RollingDistance(vehicle)
        self._watch = DriveWatch(plan.fence, plan.speed, self._rolling)
        self._law = SpeedLaw(vehicle, max_throttle=MAX_THROTTLE)
        self._mean_throttle = 0.0
        self._start: Pose | None = None
        self._frames: list[DriveFrame] = []
        self._ticks = 0
        self._rested = 0.0
        self._dt = 0.0
        self._neutral = files.neutral_us
        self._span = files.config.throttle.span_us
        self._count = counter_of(files)[1]

    def drive(self, progress: Progress = lambda share, text: None) -> ExperimentDrive:
        """Drive every segment in order; fence and top speed end the drive, its data remain.

        Raises ExperimentFailed if car or sensors do not respond, and the errors of the Car.
        """
        stopped = ""
        segments = iter(self._plan.segments)
        segment: Segment | None = next(segments)
        done = 0
        began: float | None = None
        first: float | None = None
        last: float | None = None
        try:
            for state in self._car.states():
                self._dt = 0.0 if last is None else min(state.t - last, 0.1)
                last = state.t
                began = state.t if began is None else began
                first = state.t if first is None else first
                pose = self._locate(state)
                while segment is not None and self._is_over(segment, state, pose, state.t - first):
                    segment = next(segments, None)
                    first = state.t
                    done = done + 1
                if segment is None:
                    break
                self._command(segment, state, pose, state.t - first, began)
                if len(self._frames) % 20 == 0:
                    progress(done / len(self._plan.segments), segment.name)
        except DriveStopped as reason:
            stopped = str(reason)
        finally:
            self._car.stop()
        return ExperimentDrive(self._plan, tuple(self._frames), stopped)

    # -- one frame -----------------------------------------------------------

    def _locate(self, state: State) -> Pose:
        if self._start is None:
            self._start = state.pose
            self._ticks = state.ticks
        pose = in_frame(state.pose, self._start)
        if self._track is not None:
            self._track.update(pose)
        self._rested = 0.0 if state.ticks != self._ticks else self._rested + self._dt
        self._ticks = state.ticks
        return pose

    def _command(self, segment: Segment, state: State, pose: Pose, t: float,
                 began: float) -> None:
        throttle = self._throttle(segment, state, t)
        steering = self._steering(segment, state, pose, t)
        # Append before the watch checks, so that a picture shows where the drive ended.
        self._frames.append(DriveFrame(state.t - began, pose, state.speed, throttle,
                                       self._map.command_of(steering), segment.name,
                                       segment.measured))
        self._watch.look(state, pose, throttle, self._car.mode, self._car.causes,
                         self._lane(segment, pose))
        self._car.drive(steering=steering, throttle=throttle, source=SOURCE)

    def _throttle(self, segment: Segment, state: State, t: float) -> float:
        if segment.throttle is not None:
            level = segment.throttle(t) + (self._mean_throttle if segment.relative else 0.0)
            return max(level, 0.0) if isinstance(segment.throttle,
                                                 Ramp) else self._round_to_count(level)
        if segment.speed == 0.0:
            self._law.reset()
            self._mean_throttle = 0.0
            return 0.0
        throttle = self._law.throttle(segment.speed, state.speed, self._dt)
        share = min(self._dt / THROTTLE_MEAN_TIME, 1.0)
        self._mean_throttle += (throttle - self._mean_throttle) * (share if self._mean_throttle
                                                                   else 1.0)
        return throttle

    def _round_to_count(self, throttle: float) -> float:
        """Round the throttle to a whole count of the PWM: no dithering between two."""
        throttle = max(throttle, 0.0)
        pulse = round((self._neutral + self._span * throttle) / self._count) * self._count
        return (pulse - self._neutral) / self._span if throttle else 0.0

    def _steering(self, segment: Segment, state: State, pose: Pose, t: float) -> float:
        """Compute the road-wheel angle [rad] by the map that the Car inverts."""
        if not isinstance(segment.steering, str):
            return self._map.angle_of(max(-1.0, min(1.0, segment.steering(t))))
        assert self._track is not None
        follow = (self._track.along_lane if segment.steering == "lane"
                  else self._track.along_path)
        return follow(pose, state.speed, self._wheelbase)

    def _lane(self, segment: Segment, pose: Pose) -> Pose | None:
        if isinstance(segment.steering, str) and self._track is not None:
            return self._track.nearest(pose, lane=segment.steering == "lane")
        return None

    # -- the end of a segment --------------------------------------------------

    def _is_over(self, segment: Segment, state: State, pose: Pose, t: float) -> bool:
        return (t >= segment.seconds or state.speed >= segment.top_speed
                or abs(state.speed * (state.yaw_rate or 0.0)) >= segment.top_lateral
                or (segment.rolls_out and self._lane_ends(state))
                or self._is_reached(segment, pose))

    def _lane_ends(self, state: State) -> bool:
        return (self._track is not None
                and self._track.remaining < self._rolling(state.speed) + 0.1)

    def _is_reached(self, segment: Segment, pose: Pose) -> bool:
        if segment.until == "standstill":
            return self._rested > STANDSTILL_DELAY
        if segment.until == "room":
            return self._track is not None and self._track.remaining >= segment.room
        if segment.until == "heading":
            return (abs(pose.yaw) > math.pi
                    and abs(math.remainder(pose.yaw, 2.0 * math.pi)) < HEADING_TOLERANCE)
        return False


def run_plan(car: ExperimentCar, plan: ExperimentPlan, progress: Progress = lambda share,
             text: None) -> ExperimentDrive:
    """Drive ``plan`` on an armed car; see ``Runner.drive``."""
    return ExperimentRunner(car, plan).drive(progress)


def insert_figures(plan: ExperimentPlan, drive: ExperimentDrive) -> ExperimentPlan:
    """Insert time, path and top speed of a drive (the rehearsal) into the plan."""
    frames = drive.frames
    steps = [math.hypot(b.pose.x - a.pose.x, b.pose.y - a.pose.y)
             for a, b in pairwise(frames)]
    return replace(plan, seconds=frames[-1].t, path=sum(steps),
                   reached=max(0.0, *(f.speed for f in frames)))
