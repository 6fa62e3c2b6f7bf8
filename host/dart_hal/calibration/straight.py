"""Roll straight ahead from rest to rest, with an uncalibrated car.

The steering is feedback of heading and offset of the odometry, so that an unknown servo centre does
not bend the path.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Doubt, Pose, State
from dart_hal.vehicle.sets import PAPER

from .runner import CalibrationRunner, check_pull, no_imu_error

# rad/rad and rad/m: the offset y follows y'' + 1.6 y' + 0.35 y = 0 at 0.35 m/s, overdamped.
HEADING_GAIN = 0.8
OFFSET_GAIN = 0.5
# rad of road wheel per unit of command near the centre, mean of both sides of the map.
STEERING_SLOPE = 0.5 * (PAPER.steering.k_left * PAPER.steering.a_left_rad
                        + PAPER.steering.k_right * PAPER.steering.a_right_rad)
# Share of the command range; the centre of a servo is off by at most a third of the range.
MAX_CORRECTION = 0.5
# rad; a car whose steering has the correct sign never turns that far from the line.
MAX_HEADING_ERROR = 0.7
# Without the gyro, the heading of the State is computed from the steering, not measured.
GYRO_DOUBTS = frozenset({Doubt.IMU_DISAGREES.value, Doubt.IMU_ZERO.value})
# s without a yaw rate after which the heading is not measured any more: with it computed from the
# steering, a tape along the chord was up to 2 % short and nothing showed it.
MAX_IMU_SILENCE = 0.2
# s without an edge that count as rest.
REST_DURATION = 0.5
# s, longest wait until the car has come to rest.
MAX_ROLL_OUT = 6.0

FrameCallback = Callable[[State], float | None]
"""Takes a State and returns the throttle pulse [us]; None: that of the speed loop."""


@dataclass(frozen=True, slots=True)
class Rolled:
    """One roll: edges of ring A; path and chord [m] by odometry; duration [s]."""

    edges: int
    path: float
    chord: float
    duration: float

    @property
    def bend(self) -> float:
        """Return by how much a tape along the chord is too short [m]."""
        return self.path - self.chord


class LineKeeper:
    """Steer along the line given by the pose at the start."""

    def __init__(self, files: CarFiles, start: Pose) -> None:
        steering = files.config.steering
        self._center = steering.center_us
        self._span = steering.span_us * steering.direction
        self._start = start

    def pulse(self, state: State) -> float:
        """Return the steering pulse [us] back to the line.

        Raises CalibrationFailed for a large heading error, and without a gyro or with doubts about
        it: the odometry ignores a gyro that contradicts the steering, so the heading would not show
        it.
        """
        if state.yaw_rate is None and state.health.imu_age > MAX_IMU_SILENCE:
            raise no_imu_error(f"no yaw rate for {state.health.imu_age:.1f} s")
        start, pose = self._start, state.pose
        yaw = pose.yaw - start.yaw
        doubts = sorted(name for name in state.health.doubts if name in GYRO_DOUBTS)
        if doubts or abs(yaw) > MAX_HEADING_ERROR:
            raise CalibrationFailed(
                "the car does not keep a straight line",
                found=", ".join([*doubts, f"turned by {yaw:+.2f} rad"]),
                expected=f"less than {MAX_HEADING_ERROR} rad, and a gyro that agrees with the "
                         "steering",
                likely="servo or gyro (IMU upside down) turn in the wrong direction, or the "
                       "servo is unplugged",
                remedy="dart-hal calibrate steering shows which of them; then [steering] "
                       "direction = -1, or mount_roll = 3.1416 under [imu] in car.toml")
        dx = pose.x - start.x
        dy = pose.y - start.y
        offset = dy * math.cos(start.yaw) - dx * math.sin(start.yaw)
        angle = -HEADING_GAIN * yaw - OFFSET_GAIN * offset
        command = angle / STEERING_SLOPE
        return self._center + self._span * min(max(command, -MAX_CORRECTION), MAX_CORRECTION)


def roll(runner: CalibrationRunner, files: CarFiles, metres: float, speed: float,
         on_frame: FrameCallback = lambda state: None) -> Rolled:
    """Roll ``metres`` (by the odometry) at ``speed`` [m/s], then coast to rest.

    on_frame: called with every State until the throttle ends. Raises CalibrationFailed with the
    likely cause, and errors of the Car.
    """
    first = rest(runner, files.config.steering.center_us)
    line = LineKeeper(files, first.pose)
    pulse = line.pulse(first)
    per_edge = files.metres_per_edge.value
    states: list[State] = []
    throttle: float | None = None
    while True:
        state = runner.hold(0.0, pulse, speed, throttle)[-1]
        states.append(state)
        check_pull(states, speed)
        throttle = on_frame(state)
        pulse = line.pulse(state)
        if (state.ticks - first.ticks) * per_edge >= metres:
            break
    last = rest(runner, pulse)
    edges = last.ticks - first.ticks
    chord = math.hypot(last.pose.x - first.pose.x, last.pose.y - first.pose.y)
    return Rolled(edges, edges * per_edge, chord, last.t - first.t)


def rest(runner: CalibrationRunner, steering_us: float) -> State:
    """Wait at neutral until no edge is counted for ``REST_DURATION``.

    Raises CalibrationFailed if the car keeps rolling.
    """
    state = runner.hold(0.0, steering_us, 0.0)[-1]
    begin = state.t
    quiet_since = state.t
    while state.t - quiet_since < REST_DURATION:
        before = state.ticks
        state = runner.hold(0.0, steering_us, 0.0)[-1]
        if state.ticks != before:
            quiet_since = state.t
        if state.t - begin > MAX_ROLL_OUT:
            raise CalibrationFailed(
                "the car rolls at a neutral throttle", found=f"edges for {MAX_ROLL_OUT:.0f} s",
                expected="standstill", likely="neutral of the ESC is off, or the floor slopes",
                remedy="level the floor; or [throttle] neutral_us in car.toml")
    return state
