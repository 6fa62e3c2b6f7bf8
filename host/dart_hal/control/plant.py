"""What a tracker has to know of one car: how it corners, how late it steers, and its stops."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import cos, exp, inf, sin
from typing import NamedTuple

from dart_hal.control.lqr import Gains, gains_of
from dart_hal.control.measured import vehicle_for
from dart_hal.control.steady import Steady
from dart_hal.control.tuning import TO_PULSE
from dart_hal.core.config import CarFiles
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import MotionEstimate
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering, make_steering_inverse

# s from a pulse to the road wheels, of a car of which nobody measured it: 5 to 30 ms.
SERVO = 0.02
# 1/s in commands of -1..1: a servo that turns 60 deg in 0.17 s, a command of 1 for 375 us.
SLEW = 10.0
# s of the prediction: at 2 m/s the wheels turn by 0.04 rad at most, the car goes on 2 cm.
SUBSTEP = 0.01
# s in which an error of the angle is learnt, rad at most, m/s: slower, noise is no curvature. A
# steering map is 0.3 deg off, a backlash 2 deg wide; the lag that was identified 10 ms.
BIAS_TIME = 0.6
BIAS_MOST = 0.06
BIAS_ABOVE = 0.4
# s: half the PWM frame for which a command is held, and what the yaw rate comes behind the
# wheels: by the linear bicycle of the later published set 8 ms at 1 m/s, 12 at 2.
SETTLES = 0.5 * PWM_FRAME + 0.012
# s of commands that are kept: more than any car takes to steer.
KEPT = 0.5
# s for which one motion is taken at most: what came in a gap, nobody saw.
TELLS = 0.1


@dataclass(frozen=True, slots=True)
class Late:
    """How late the servo turns: transport [s] from a command until it acts, lag [s] first-order
    behind it, slew at most, in commands of -1..1 per s. All of it lies before the linkage, whose
    map bends: wheels come back from a stop later than they go there. settles [s]: what the car
    turns behind a command that changes all the time, beyond."""

    transport: float
    lag: float = 0.0
    slew: float = SLEW
    settles: float = SETTLES


@dataclass(frozen=True)
class Plant:
    """vehicle: the identified model; lock [rad]: the stops of the wheels, right and left;
    throttle: the most that may be asked for."""

    vehicle: Vehicle
    late: Late
    lock: tuple[float, float]
    throttle: float = 1.0

    @cached_property
    def angle_of(self) -> Callable[[float], float]:
        """Road-wheel angle [rad] of a command -1..1, by the model's map."""
        curve: Callable[[float], float] = make_steering(self.vehicle.steering)
        return curve

    @cached_property
    def command_of(self) -> Callable[[float], float]:
        """The inverse; -1 and 1 are its ends."""
        return make_steering_inverse(self.vehicle.steering)

    @cached_property
    def gains(self) -> Gains:
        """Of the LQR tracker, for these bends and this lag."""
        return gains_of(self.steady, self.late.lag)

    @cached_property
    def steady(self) -> Steady:
        """Its bends, by the model."""
        return Steady(self.vehicle)


def plant_of(files: CarFiles) -> Plant:
    """By calibration.toml where it says so, else model.toml, else what cars of this kind do."""
    vehicle = settled(vehicle_for(files))
    measured = files.calibration.latency if files.calibration else None
    known = measured is not None and measured.pulse_to_yaw is not None
    delay = vehicle.delay.steering_s
    lag = vehicle.delay.steering_lag_s
    if files.model is None:
        delay = SERVO
        lag = 0.0
    to_pulse = TO_PULSE
    if measured is not None and measured.command_to_pulse is not None:
        to_pulse = max(measured.command_to_pulse.value, 0.0)
    if measured is not None and known and measured.pulse_to_yaw is not None:
        delay = max(measured.pulse_to_yaw.value, 0.0)
        lag = max(measured.pulse_to_yaw_lag.value, 0.0) if measured.pulse_to_yaw_lag else 0.0
    return Plant(vehicle, Late(to_pulse + delay, lag), lock_of(files),
                 files.config.limits.max_throttle)


def lock_of(files: CarFiles) -> tuple[float, float]:
    """Steering angles [rad] at which the map or [limits] max_steering ends."""
    table = files.calibration.steering.map if files.calibration else None
    if table is None:
        curve = make_steering(PAPER.steering)
        ends = curve(-1.0), curve(1.0)
    else:
        ends = min(table.angle_rad), max(table.angle_rad)
    most = files.config.limits.max_steering
    return max(ends[0], -most), min(ends[1], most)


class Where(NamedTuple):
    """A predicted motion at t [s]: rear axle x, y [m], yaw [rad], speed [m/s], angle of the road
    wheels [rad]; servo, where it stands for that, -1..1."""

    t: float
    x: float
    y: float
    yaw: float
    speed: float
    angle: float
    servo: float

    def course(self, plant: Plant) -> float:
        """Direction [rad] in which the rear axle goes: beside the heading, as its tyres slip."""
        steady = plant.steady
        return self.yaw + steady.turn(steady.bend(self.angle, self.speed), self.speed).slip


class Prediction:
    """Where the car will be, by its model and by the commands that are on their way.

    ``sent`` with every command, ``see`` with every motion, ``at`` for a later time. What the car
    turned more than the model says of its wheels is taken for an error of the angle that stays
    (map, backlash): ``bias`` [rad]; learns False: somebody else sets it.
    """

    def __init__(self, plant: Plant, *, learns: bool = True) -> None:
        self.plant = plant
        self._learns = learns
        self.reset()

    def reset(self) -> None:
        """Forget commands and bias."""
        self.bias = 0.0
        self._queue: deque[tuple[float, float]] = deque()
        self._t, self._servo = -inf, self.plant.command_of(0.0)

    def wheels(self, servo: float) -> float:
        """Angle [rad] at which the wheels stand for a servo at -1..1, by what was learnt."""
        return self.plant.angle_of(servo) + self.bias

    def asked(self, angle: float) -> float:
        """Angle [rad] to command so that the wheels come to ``angle``."""
        return angle - self.bias

    def sent(self, t: float, angle: float) -> None:
        """At t [s] an angle [rad] was commanded; it acts a transport later."""
        self._queue.append((t + self.plant.late.transport, self.plant.command_of(angle)))

    def see(self, now: MotionEstimate) -> None:
        """The servo comes to the time of ``now``. There alone it is compared with what the car
        turns: where it stood before belongs to motions that are over."""
        if self._t == -inf:
            self._t = now.t
        since = max(self._t, now.t - TELLS)
        while self._t < now.t - 1e-9:
            step = min(SUBSTEP, now.t - self._t)
            self._servo = self._turned(self._servo, self._t + step, step)
            self._t += step
        if now.t > since + 1e-9:
            self._learn(now, now.t - since)

    def at(self, now: MotionEstimate, t: float) -> Where:
        """The motion that is known of ``now``, at a later t [s]: speed and what acts go on."""
        self.see(now)
        while len(self._queue) > 1 and self._queue[1][0] < now.t - KEPT:
            self._queue.popleft()
        pose = now.pose
        servo = self._servo
        steady = self.plant.steady
        x = pose.x
        y = pose.y
        yaw = pose.yaw
        at = now.t
        while at < t - 1e-9:
            step = min(SUBSTEP, t - at)
            at += step
            servo = self._turned(servo, at, step)
            bend = steady.bend(self.wheels(servo), now.speed)
            turn = bend * now.speed * step
            way = now.speed * step
            course = yaw + steady.turn(bend, now.speed).slip + 0.5 * turn
            x = x + way * cos(course)
            y = y + way * sin(course)
            yaw = yaw + turn
        return Where(at, x, y, yaw, now.speed, self.wheels(servo), servo)

    def _learn(self, now: MotionEstimate, step: float) -> None:
        if now.speed < BIAS_ABOVE or not self._learns:
            return
        curvature = self.plant.steady.bend(self.wheels(self._servo), now.speed)
        error = self.plant.vehicle.body.wheelbase * (now.yaw_rate / now.speed - curvature)
        self.bias = min(max(self.bias + error * step / BIAS_TIME, -BIAS_MOST), BIAS_MOST)

    def _turned(self, servo: float, t: float, step: float) -> float:
        """The servo ``step`` s later, at t [s], as a command."""
        target = servo
        for acts, command in self._queue:
            if acts > t - 0.5 * step:
                break
            target = command
        late = self.plant.late
        share = 1.0 - exp(-step / late.lag) if late.lag > 0.0 else 1.0
        most = late.slew * step
        return servo + min(max(share * (target - servo), -most), most)
