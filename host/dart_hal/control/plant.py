"""Model of one car for the trackers: its steady cornering, the delay of its steering, its stops."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import cos, exp, inf, sin
from typing import NamedTuple

from dart_hal.control.drivetrain import DEFAULT_BRAKE
from dart_hal.control.lqr import LqrGains, compute_gains
from dart_hal.control.measured import min_brake, vehicle_for
from dart_hal.control.steady import Steady
from dart_hal.control.tuning import PULSE_DELAY
from dart_hal.core.config import CarFiles
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import MotionEstimate
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering, make_steering_inverse

# Time from a pulse to the road wheels of a car without a measurement [s]: 5 to 30 ms.
DEFAULT_SERVO_DELAY = 0.02
# Rate limit of the servo in commands of -1..1 [1/s]: 60 deg in 0.17 s, a command of 1 for 375 us.
SERVO_SLEW = 10.0
# Step of the prediction [s]: at 2 m/s the wheels turn by 0.04 rad at most and the car moves by 2
# cm.
PREDICTION_STEP = 0.01
# Time constant of the bias [s], its largest value [rad], and the minimum speed [m/s], below which
# noise hides the curvature. A steering map is 0.3 deg off, a backlash 2 deg wide; the identified
# lag is off by 10 ms.
BIAS_TIME = 0.6
MAX_BIAS = 0.06
MIN_BIAS_SPEED = 0.4
# Additional delay of the yaw rate [s]: half the PWM frame for which a command is constant, and the
# lag of the yaw rate after the wheels, by the linear bicycle of the later published set 8 ms at 1
# m/s, 12 ms at 2 m/s.
YAW_DELAY = 0.5 * PWM_FRAME + 0.012
# Age up to which commands are stored [s]: longer than the steering delay of any car.
COMMAND_MEMORY = 0.5
# Longest time that one motion represents [s]: nothing is known of a longer gap.
MAX_LEARNING_GAP = 0.1


@dataclass(frozen=True, slots=True)
class SteeringDelay:
    """Delay of the steering.

    transport [s]: from a command until it acts; lag [s]: first-order, after it; slew: rate limit in
    commands of -1..1 per s. All of it acts before the linkage, whose map is nonlinear: wheels
    return from a stop more slowly than they go there. yaw_delay [s]: additional delay of the yaw
    rate after a command that changes all the time.
    """

    transport: float
    lag: float = 0.0
    slew: float = SERVO_SLEW
    yaw_delay: float = YAW_DELAY


@dataclass(frozen=True)
class Plant:
    """A car as the trackers see it.

    vehicle: the identified model; lock [rad]: stops of the wheels, right and left; max_throttle:
    the largest throttle that may be commanded; brake [m/s2]: what the largest brake adds to the
    deceleration.
    """

    vehicle: Vehicle
    delay: SteeringDelay
    lock: tuple[float, float]
    max_throttle: float = 1.0
    brake: float = DEFAULT_BRAKE

    @cached_property
    def angle_of(self) -> Callable[[float], float]:
        """Road-wheel angle [rad] of a command -1..1, by the map of the model."""
        curve: Callable[[float], float] = make_steering(self.vehicle.steering)
        return curve

    @cached_property
    def command_of(self) -> Callable[[float], float]:
        """Inverse of ``angle_of``; beyond the ends of the map -1 and 1."""
        return make_steering_inverse(self.vehicle.steering)

    @cached_property
    def gains(self) -> LqrGains:
        """Gains of the LQR tracker for this steady cornering and lag."""
        return compute_gains(self.steady, self.delay.lag)

    @cached_property
    def steady(self) -> Steady:
        """Tables of steady cornering by the model."""
        return Steady(self.vehicle)


def plant_of(files: CarFiles) -> Plant:
    """Return the plant of a car: by calibration.toml, else model.toml, else typical values."""
    vehicle = apply_parameter_effects(vehicle_for(files))
    measured = files.calibration.latency if files.calibration else None
    is_measured = measured is not None and measured.pulse_to_yaw is not None
    servo_delay = vehicle.delay.steering_s
    lag = vehicle.delay.steering_lag_s
    if files.model is None:
        servo_delay = DEFAULT_SERVO_DELAY
        lag = 0.0
    to_pulse = PULSE_DELAY
    if measured is not None and measured.command_to_pulse is not None:
        to_pulse = max(measured.command_to_pulse.value, 0.0)
    if measured is not None and is_measured and measured.pulse_to_yaw is not None:
        servo_delay = max(measured.pulse_to_yaw.value, 0.0)
        lag = max(measured.pulse_to_yaw_lag.value, 0.0) if measured.pulse_to_yaw_lag else 0.0
    return Plant(vehicle, SteeringDelay(to_pulse + servo_delay, lag), lock_of(files),
                 files.config.limits.max_throttle, min_brake(files))


def lock_of(files: CarFiles) -> tuple[float, float]:
    """Return the steering angles [rad] at the ends of the map or of [limits] max_steering."""
    table = files.calibration.steering.map if files.calibration else None
    if table is None:
        curve = make_steering(PAPER.steering)
        ends = curve(-1.0), curve(1.0)
    else:
        ends = min(table.angle_rad), max(table.angle_rad)
    most = files.config.limits.max_steering
    return max(ends[0], -most), min(ends[1], most)


class PredictedMotion(NamedTuple):
    """A motion predicted for t [s].

    x, y [m], yaw [rad]: pose of the rear axle; speed [m/s]; angle [rad]: of the road wheels; servo
    -1..1: position of the servo for that angle.
    """

    t: float
    x: float
    y: float
    yaw: float
    speed: float
    angle: float
    servo: float

    def course(self, plant: Plant) -> float:
        """Direction of motion of the rear axle [rad]: heading plus slip."""
        steady = plant.steady
        return self.yaw + steady.turn(steady.curvature(self.angle, self.speed), self.speed).slip


class MotionPrediction:
    """Prediction of the motion by the model and by the commands that do not act yet.

    Call ``record_command`` with every command, ``update`` with every motion, ``predict`` for a
    later time. A difference between the measured yaw rate and that of the model is attributed to a
    constant error of the steering angle (map, backlash): ``bias`` [rad]. learns_bias False: the
    caller sets it.
    """

    def __init__(self, plant: Plant, *, learns_bias: bool = True) -> None:
        self.plant = plant
        self._learns_bias = learns_bias
        self.reset()

    def reset(self) -> None:
        """Forget commands and bias."""
        self.bias = 0.0
        self._queue: deque[tuple[float, float]] = deque()
        self._t, self._servo = -inf, self.plant.command_of(0.0)

    def wheel_angle(self, servo: float) -> float:
        """Return the wheel angle [rad] for a servo position -1..1, with the estimated error."""
        return self.plant.angle_of(servo) + self.bias

    def compensate(self, angle: float) -> float:
        """Return the angle [rad] to command so that the wheels reach ``angle``."""
        return angle - self.bias

    @property
    def angle_error(self) -> float:
        """Error [rad] of the steering angle that was learnt, at the present servo position."""
        return self.wheel_angle(self._servo) - self.plant.angle_of(self._servo)

    def record_command(self, t: float, angle: float) -> None:
        """Record a command: an angle [rad] at t [s], which acts one transport delay later."""
        self._queue.append((t + self.plant.delay.transport, self.plant.command_of(angle)))

    def update(self, now: MotionEstimate) -> None:
        """Advance the servo to the time of a motion and learn the bias.

        The bias is learnt at this time only: earlier servo positions belong to earlier motions.
        """
        if self._t == -inf:
            self._t = now.t
        since = max(self._t, now.t - MAX_LEARNING_GAP)
        while self._t < now.t - 1e-9:
            step = min(PREDICTION_STEP, now.t - self._t)
            self._servo = self._move_servo(self._servo, self._t + step, step)
            self._t += step
        if now.t > since + 1e-9:
            self._learn_bias(now, now.t - since)

    def predict(self, now: MotionEstimate, t: float) -> PredictedMotion:
        """Predict the motion at a later t [s], at the present speed.

        Integrates in steps of PREDICTION_STEP: servo by its commands, curvature by the tables of
        steady cornering, pose along the course of the rear axle (midpoint rule).
        """
        self.update(now)
        while len(self._queue) > 1 and self._queue[1][0] < now.t - COMMAND_MEMORY:
            self._queue.popleft()
        pose = now.pose
        servo = self._servo
        steady = self.plant.steady
        x = pose.x
        y = pose.y
        yaw = pose.yaw
        t_now = now.t
        while t_now < t - 1e-9:
            step = min(PREDICTION_STEP, t - t_now)
            t_now += step
            servo = self._move_servo(servo, t_now, step)
            curvature = steady.curvature(self.wheel_angle(servo), now.speed)
            turn = curvature * now.speed * step
            distance = now.speed * step
            course = yaw + steady.turn(curvature, now.speed).slip + 0.5 * turn
            x = x + distance * cos(course)
            y = y + distance * sin(course)
            yaw = yaw + turn
        return PredictedMotion(t_now, x, y, yaw, now.speed, self.wheel_angle(servo), servo)

    def _learn_bias(self, now: MotionEstimate, step: float) -> None:
        """Integrate the error of the steering angle, wheelbase * (measured - modelled curvature).
        """
        if now.speed < MIN_BIAS_SPEED or not self._learns_bias:
            return
        curvature = self.plant.steady.curvature(self.wheel_angle(self._servo), now.speed)
        error = self.plant.vehicle.body.wheelbase * (now.yaw_rate / now.speed - curvature)
        self.bias = min(max(self.bias + error * step / BIAS_TIME, -MAX_BIAS), MAX_BIAS)

    def _move_servo(self, servo: float, t: float, step: float) -> float:
        """Return the servo position ``step`` s later, at t [s]."""
        target = servo
        for t_acts, command in self._queue:
            if t_acts > t - 0.5 * step:
                break
            target = command
        delay = self.plant.delay
        share = 1.0 - exp(-step / delay.lag) if delay.lag > 0.0 else 1.0
        max_step = delay.slew * step
        return servo + min(max(share * (target - servo), -max_step), max_step)
