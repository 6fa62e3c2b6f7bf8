"""Rolling straight ahead from rest to rest, on a car of which nothing is calibrated yet.

The steering is fed back from heading and offset of the odometry, so that an
unknown servo centre does not bend the path.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Doubt, Pose, State
from dart_hal.vehicle.sets import PAPER

from .runner import Runner, check_pull

HEADING, OFFSET = 0.8, 0.5
"""rad/rad and rad/m: y'' + 1.6 y' + 0.35 y = 0 at 0.35 m/s, overdamped."""
STEEPNESS = 0.5 * (PAPER.steering.k_left * PAPER.steering.a_left_rad
                   + PAPER.steering.k_right * PAPER.steering.a_right_rad)
"""rad of road wheel per unit of command near the centre, mean of both sides of the map."""
MOST = 0.5
"""Of the command range; a servo centre is off by at most a third of it."""
ASTRAY = 0.7
"""rad; a car whose steering answers the right way never turns that far away."""
DOUBTS = frozenset({Doubt.IMU_DISAGREES.value, Doubt.IMU_ZERO.value})
"""Without the gyro the heading is the one that was steered, not the one that came of it."""
AT_REST, PATIENCE = 0.5, 6.0
"""s without an edge that count as rest; s of rolling out that are waited for."""

EachFrame = Callable[[State], float | None]
"""Sees a State; the throttle's pulse [us] that answers it, None: the one that keeps the speed."""


@dataclass(frozen=True, slots=True)
class Rolled:
    """edges of ring A; path, chord [m] by odometry; duration [s]."""

    edges: int
    path: float
    chord: float
    duration: float

    @property
    def bend(self) -> float:
        """m by which a tape along the chord is too short."""
        return self.path - self.chord


class Straight:
    """Keeps the line on which the car stood when this was made."""

    def __init__(self, files: CarFiles, start: Pose) -> None:
        steering = files.config.steering
        self._center = steering.center_us
        self._span = steering.span_us * steering.direction
        self._start = start

    def pulse(self, state: State) -> float:
        """Steering pulse [us] back to the line. Errors: CalibrationFailed far off it.

        A gyro that contradicts the steering is no longer part of the pose, so
        the doubt itself counts.
        """
        start, pose = self._start, state.pose
        yaw = pose.yaw - start.yaw
        doubts = sorted(name for name in state.health.doubts if name in DOUBTS)
        if doubts or abs(yaw) > ASTRAY:
            raise CalibrationFailed(
                "the car does not keep a straight line",
                found=", ".join([*doubts, f"turned by {yaw:+.2f} rad"]),
                expected=f"less than {ASTRAY} rad, and a gyro that agrees with the steering",
                likely="the servo turns the wrong way, or the gyro does (IMU upside down), or "
                       "the servo is unplugged",
                remedy="dart-hal calibrate steering tells them apart; then [steering] "
                       "direction = -1, or mount_roll = 3.1416 under [imu] in car.toml")
        dx, dy = pose.x - start.x, pose.y - start.y
        offset = dy * math.cos(start.yaw) - dx * math.sin(start.yaw)
        angle = -HEADING * yaw - OFFSET * offset
        return self._center + self._span * min(max(angle / STEEPNESS, -MOST), MOST)


def roll(runner: Runner, files: CarFiles, metres: float, speed: float,
         each: EachFrame = lambda state: None) -> Rolled:
    """Roll ``metres`` (by the odometry) at ``speed`` [m/s] and out to rest.

    ``each`` sees every State while the car is pulled. Errors: CalibrationFailed
    with the likely cause, and what the Car raises.
    """
    first = rest(runner, files.config.steering.center_us)
    line = Straight(files, first.pose)
    pulse = line.pulse(first)
    per_edge = files.metres_per_edge.value
    seen: list[State] = []
    throttle: float | None = None
    while True:
        state = runner.hold(0.0, pulse, speed, throttle)[-1]
        seen.append(state)
        check_pull(seen, speed)
        throttle = each(state)
        pulse = line.pulse(state)
        if (state.ticks - first.ticks) * per_edge >= metres:
            break
    last = rest(runner, pulse)
    edges = last.ticks - first.ticks
    chord = math.hypot(last.pose.x - first.pose.x, last.pose.y - first.pose.y)
    return Rolled(edges, edges * per_edge, chord, last.t - first.t)


def rest(runner: Runner, steering_us: float) -> State:
    """Wait at neutral until no edge has come for a while. Errors: CalibrationFailed."""
    state = runner.hold(0.0, steering_us, 0.0)[-1]
    begin = quiet_since = state.t
    while state.t - quiet_since < AT_REST:
        before = state.ticks
        state = runner.hold(0.0, steering_us, 0.0)[-1]
        if state.ticks != before:
            quiet_since = state.t
        if state.t - begin > PATIENCE:
            raise CalibrationFailed(
                "the car rolls at a neutral throttle", found=f"edges for {PATIENCE:.0f} s",
                expected="standstill", likely="neutral of the ESC is off, or the floor slopes",
                remedy="level the floor; or [throttle] neutral_us in car.toml")
    return state
