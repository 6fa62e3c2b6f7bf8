"""The steering experiment: the sweep of ``calibrate steering``, fenced and recorded.

Full right to full left and back at two slow speeds. Every level is a whole number of counts and is
held until the servo rests. The procedure of the calibration drives it, so that one drive gives
calibration.toml and the five-parameter map.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from dart_hal.calibration.runner import DrivableCar
from dart_hal.calibration.schedule import SWEEP_SPEEDS
from dart_hal.calibration.schedule import SteeringPlan as Sweep
from dart_hal.calibration.steering import drive as sweep
from dart_hal.calibration.steering import plan as sweep_of
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import ExperimentFailed
from dart_hal.core.types import Applied, State
from dart_hal.vehicle.load import vehicle_of

from .floor import Floor, StartPlace
from .limits import RollingDistance
from .plans import ExperimentPlan
from .runner import DriveFrame, ExperimentDrive, Progress
from .watch import DriveStopped, check_inside, check_top_speed, in_frame

# Slower over faster speed; their difference identifies the slip of the tyres.
SPEED_RATIO = SWEEP_SPEEDS[0] / SWEEP_SPEEDS[1]
# [m/s] Least speed of the faster sweep: below it the encoder has too few edges.
MIN_SWEEP_SPEED = 0.35


def plan_steering(files: CarFiles, floor: Floor, speed: float | None) -> ExperimentPlan:
    """Plan the sweep for this floor; speed [m/s] of its faster half, None: what fits.

    Raises ExperimentFailed if the floor is too small, with the size that is needed.
    """
    fastest = speed if speed is not None else SWEEP_SPEEDS[1]
    room = 0.5 * min(floor.length, floor.width)
    tried = fastest
    route = _sweep(files, tried)
    while speed is None and route.radius > room and tried > MIN_SWEEP_SPEED:
        tried = max(tried - 0.05, MIN_SWEEP_SPEED)
        route = _sweep(files, tried)
    if route.radius > room:
        slowest = _sweep(files, MIN_SWEEP_SPEED).radius
        fits = slowest <= room
        raise ExperimentFailed(
            f"a floor of {floor} is too small for the steering test at {tried:.2f} m/s",
            found=f"{room:.2f} m from the middle to the nearest edge",
            expected=f"{_round_up(route.radius)} m all around the car"
            + ("" if fits or tried <= MIN_SWEEP_SPEED
               else f", {_round_up(slowest)} m at {MIN_SWEEP_SPEED} m/s"),
            remedy="without --speed it is as slow as the floor requires" if fits
            else f"a larger floor (--space {2.0 * float(_round_up(slowest)):g}): nearly straight "
            "levels need a long way")
    return ExperimentPlan("steering", (), floor, StartPlace(0.5 * floor.length, 0.5 * floor.width),
                          tried, seconds=route.time, path=route.path, reached=tried, sweep=route)


def _round_up(metres: float) -> str:
    return f"{math.ceil(20.0 * metres - 1e-9) / 20.0:.2f}"


def _sweep(files: CarFiles, fastest: float) -> Sweep:
    return sweep_of(files, speeds=(SPEED_RATIO * fastest, fastest))


def run_steering(car: DrivableCar, plan: ExperimentPlan, progress: Progress) -> ExperimentDrive:
    """Drive the sweep inside ``with car.raw():``; see ``runner.run``.

    Raises CalibrationFailed if car, encoder or gyro do not respond.
    """
    assert plan.sweep is not None
    fenced = FencedCar(car, plan)

    def on_progress(share: float, text: str) -> None:
        fenced.segment = text
        progress(share, text)

    stopped = ""
    try:
        sweep(fenced, plan.sweep, on_progress)
    except DriveStopped as reason:
        stopped = str(reason)
    finally:
        car.stop()
    return ExperimentDrive(plan, tuple(fenced.frames), stopped)


class FencedCar:
    """Wraps a Car: ends the drive at the fence and above the top speed, and stores the frames."""

    def __init__(self, car: DrivableCar, plan: ExperimentPlan) -> None:
        self.files = car.files
        self.frames: list[DriveFrame] = []
        self.segment = ""
        self._car = car
        self._plan = plan
        self._rolling = RollingDistance(vehicle_of(car.files.model))
        self._steering = car.files.config.steering
        self._throttle = 0.0
        self._command = 0.0
        self._first: State | None = None

    def states(self, *, duration: float = float("inf"), timeout: float = 0.5) -> Iterator[State]:
        for state in self._car.states(duration=duration, timeout=timeout):
            self._first = self._first or state
            pose = in_frame(state.pose, self._first.pose)
            measured = self.segment.startswith("command")
            self.frames.append(DriveFrame(state.t - self._first.t, pose, state.speed,
                                          self._throttle, self._command, self.segment, measured))
            check_top_speed(state, self._plan.speed)
            check_inside(state, pose, self._plan.fence, self._rolling)
            yield state

    def pulses(self, *, steering_us: float, throttle_us: float) -> Applied:
        steering = self._steering
        files = self.files
        self._command = ((steering_us - steering.center_us)
                         / (steering.direction * steering.span_us))
        self._throttle = (throttle_us - files.neutral_us) / files.config.throttle.span_us
        return self._car.pulses(steering_us=steering_us, throttle_us=throttle_us)

    def stop(self) -> object:
        return self._car.stop()

    def refusals(self) -> tuple[str, ...]:
        return self._car.refusals()
