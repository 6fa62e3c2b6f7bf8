"""Effects on signals in the virtual world: between pulse and wheel, between motion and sensor.

Commands are changed after the pulses, at the inputs of servo and motor. Sensor inputs are changed
before the Nano samples them. A car without such effects does not use this module.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.channels import Stepper
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.motor import make_drive
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.motion import MeanMotion, MotionModel
from dart_lab.sim.servo import ServoParams, SteeringServo


class SensorInputs(NamedTuple):
    """Inputs of the sensors: wheel speed [m/s], yaw rate [rad/s], acceleration [m/s2]."""

    wheel: float
    rate: float
    a_x: float
    a_y: float


class SignalEffects:
    """The effects of one car on its signals, tick by tick of dt [s].

    ``now``: the state of the car at the last tick, on which effects may depend.
    """

    def __init__(self, car: HiddenCar, dt: float) -> None:
        p = car.vehicle
        self.now = Now()
        self._throttle = Stepper(p, "throttle", dt)
        self._wheel, self._gyro, self._accel = (
            Stepper(p, channel, dt) for channel in ("wheel", "gyro", "accel"))
        self._drive = make_drive(p.duty_motor, p.friction)
        self._per_turn = 1.0 / car.gear_revolution
        self._turns = 0.0
        self._dt = dt
        self._lag_gain = lag_gain(car.esc.lag, dt)
        self._lagged_throttle = 0.0

    def throttle(self, t: float, throttle: float, voltage: float | None) -> float:
        """Return the throttle -1..1 at the motor from that of the ESC at time t [s].

        voltage [V] of the battery; None: not measured.
        """
        self.now = self.now._replace(t=t, voltage=voltage)
        self._lagged_throttle += self._lag_gain * (throttle - self._lagged_throttle)
        out: float = self._throttle(self._lagged_throttle, self.now)
        return out

    def sensor_inputs(self, mean: MeanMotion, motion: MotionModel, throttle: float,
                      brake: float) -> SensorInputs:
        """Return the sensor inputs of the last tick; throttle: as ``throttle`` returned it."""
        # The state after the tick; speed, yaw rate and accelerations are means over it.
        self._turns += mean.v_x * self._per_turn * self._dt
        drive = self._drive(throttle, mean.v_x, brake)
        self.now = now = Now(self.now.t + self._dt, mean.v_x, motion.v_y, mean.omega, motion.eta,
                             mean.a_x, mean.a_y, mean.omega_dot, drive, self._turns,
                             self.now.voltage)
        a_x, a_y = self._accel((mean.a_x, mean.a_y), now)
        return SensorInputs(self._wheel(mean.v_x, now), self._gyro(mean.omega, now), a_x, a_y)


class ServoWithEffects(SteeringServo):
    """A servo with a lag, and with effects on its command and on the road-wheel angle."""

    def __init__(self, params: ServoParams, rng: np.random.Generator, vehicle: Vehicle,
                 dt: float, now: Callable[[], Now]) -> None:
        super().__init__(params, rng)
        self._steering = Stepper(vehicle, "steering", dt)
        self._angle_effects = Stepper(vehicle, "angle", dt)
        self._now = now
        self._lag_gain = lag_gain(params.lag, dt)
        self._lagged_command = self.command
        self._linkage_angle = self.linkage
        self.angle: float = self._angle_effects(self._linkage_angle, now())

    def move(self, t: float, dt: float) -> float:
        now = self._now()._replace(t=t)
        # Command, lag, effects on the command, slew and play of the servo, effects on the angle.
        target = self._current_target(t)
        if target is not None:
            self._lagged_command += self._lag_gain * (target - self._lagged_command)
            command = self._steering(self._lagged_command, now)
            self._linkage_angle = self._turn_linkage(command, dt, self._linkage_angle)
        self.angle = self._angle_effects(self._linkage_angle, now)
        return self.angle


def lag_gain(lag: float, dt: float) -> float:
    """Return the gain 1 - exp(-dt / lag) of a discrete first-order lag [s] with step dt [s]."""
    return 1.0 - math.exp(-dt / lag) if lag > 0.0 else 1.0


def make_signal_effects(car: HiddenCar, dt: float) -> SignalEffects | None:
    """Return the effects of a car on its signals, None = it has none."""
    acts = car.servo.lag or car.esc.lag or any(a.effect.signals for a in car.vehicle.effects)
    return SignalEffects(car, dt) if acts else None
