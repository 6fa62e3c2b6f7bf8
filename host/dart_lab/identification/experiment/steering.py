"""The steering experiment: the sweep of ``calibrate steering``, fenced and recorded.

Full right to full left and back at two slow speeds, every level a whole number
of counts and held until the servo rests: driven by the calibration itself, so
that one drive serves calibration.toml and the five-parameter map alike.
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

from .floor import Floor, Place
from .limits import Rolling
from .plans import Plan
from .runner import Drive, Frame, Progress
from .watch import Stopped, in_frame, still_inside, too_fast

SLOWER = SWEEP_SPEEDS[0] / SWEEP_SPEEDS[1]
"""Of the two speeds; the difference tells the slip of the tyres."""
SLOWEST = 0.35
"""m/s of the faster sweep: below, the encoder's edges come too seldom."""


def plan_steering(files: CarFiles, floor: Floor, speed: float | None) -> Plan:
    """The sweep on this floor; speed [m/s] of its faster half, less if it does not fit.

    Errors: ExperimentFailed when the floor is too small, with what is needed.
    """
    fastest = speed if speed is not None else SWEEP_SPEEDS[1]
    room = 0.5 * min(floor.length, floor.width)
    tried = fastest
    route = _sweep(files, tried)
    while speed is None and route.radius > room and tried > SLOWEST:
        tried = max(tried - 0.05, SLOWEST)
        route = _sweep(files, tried)
    if route.radius > room:
        slowest = _sweep(files, SLOWEST).radius
        fits = slowest <= room
        raise ExperimentFailed(
            f"a floor of {floor} is too small for the steering test at {tried:.2f} m/s",
            found=f"{room:.2f} m from the middle to the nearest edge",
            expected=f"{_up(route.radius)} m all around the car"
            + ("" if fits or tried <= SLOWEST else f", {_up(slowest)} m at {SLOWEST} m/s"),
            remedy="without --speed it goes as slowly as the floor wants" if fits
            else f"a larger floor (--space {2.0 * float(_up(slowest)):g}): nearly straight levels "
            "lead far away")
    return Plan("steering", (), floor, Place(0.5 * floor.length, 0.5 * floor.width), tried,
                seconds=route.time, path=route.path, reached=tried, sweep=route)


def _up(metres: float) -> str:
    return f"{math.ceil(20.0 * metres - 1e-9) / 20.0:.2f}"


def _sweep(files: CarFiles, fastest: float) -> Sweep:
    return sweep_of(files, speeds=(SLOWER * fastest, fastest))


def run_steering(car: DrivableCar, plan: Plan, progress: Progress) -> Drive:
    """Drive the sweep inside ``with car.raw():``; see ``runner.run``.

    Errors: CalibrationFailed when car, encoder or gyro do not answer.
    """
    assert plan.sweep is not None
    fenced = FencedCar(car, plan)

    def told(share: float, text: str) -> None:
        fenced.segment = text
        progress(share, text)

    stopped = ""
    try:
        sweep(fenced, plan.sweep, told)
    except Stopped as reason:
        stopped = str(reason)
    finally:
        car.stop()
    return Drive(plan, tuple(fenced.frames), stopped)


class FencedCar:
    """A Car that ends the drive at the fence and above the top speed, and keeps its frames."""

    def __init__(self, car: DrivableCar, plan: Plan) -> None:
        self.files = car.files
        self.frames: list[Frame] = []
        self.segment = ""
        self._car, self._plan = car, plan
        self._rolling = Rolling(vehicle_of(car.files.model))
        self._steering = car.files.config.steering
        self._throttle = 0.0
        self._command = 0.0
        self._first: State | None = None

    def states(self, *, duration: float = float("inf"), timeout: float = 0.5) -> Iterator[State]:
        for state in self._car.states(duration=duration, timeout=timeout):
            self._first = self._first or state
            pose = in_frame(state.pose, self._first.pose)
            measured = self.segment.startswith("command")
            self.frames.append(Frame(state.t - self._first.t, pose, state.speed, self._throttle,
                                     self._command, self.segment, measured))
            too_fast(state, self._plan.speed)
            still_inside(state, pose, self._plan.fence, self._rolling)
            yield state

    def pulses(self, *, steering_us: float, throttle_us: float) -> Applied:
        steering, files = self._steering, self.files
        self._command = ((steering_us - steering.center_us)
                         / (steering.direction * steering.span_us))
        self._throttle = (throttle_us - files.neutral_us) / files.config.throttle.span_us
        return self._car.pulses(steering_us=steering_us, throttle_us=throttle_us)

    def stop(self) -> object:
        return self._car.stop()

    def refusals(self) -> tuple[str, ...]:
        return self._car.refusals()
