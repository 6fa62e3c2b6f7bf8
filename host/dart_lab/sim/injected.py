"""Effects on signals in the virtual world: between pulse and wheel, between motion and sensor.

A car without such an effect does not come here. Commands are changed behind
the pulses, where servo and motor have them; what the sensors show is changed
before they sample, so that the Nano measures it like anything else.
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
from dart_lab.sim.motion import Felt, Motion
from dart_lab.sim.servo import Servo, ServoParams


class Sensed(NamedTuple):
    """What the sensors take the motion for: speed of the wheels [m/s], gyro [rad/s], [m/s2]."""

    wheel: float
    rate: float
    a_x: float
    a_y: float


class Injected:
    """The effects of one car on its signals, tick by tick of dt [s].

    ``now``: what the effects know of the car, as of the last tick.
    """

    def __init__(self, car: HiddenCar, dt: float) -> None:
        p = car.vehicle
        self.now = Now()
        self._throttle = Stepper(p, "throttle", dt)
        self._wheel, self._gyro, self._accel = (
            Stepper(p, channel, dt) for channel in ("wheel", "gyro", "accel"))
        self._drive = make_drive(p.motor, p.friction)
        self._per_turn = 1.0 / car.gear_revolution
        self._turns = 0.0
        self._dt = dt
        self._follow, self._pull = follow(car.esc.lag, dt), 0.0

    def throttle(self, t: float, throttle: float) -> float:
        """What the motor has of the throttle -1..1 of the speed controller at time t [s]."""
        self.now = self.now._replace(t=t)
        self._pull += self._follow * (throttle - self._pull)
        out: float = self._throttle(self._pull, self.now)
        return out

    def sensed(self, felt: Felt, motion: Motion, throttle: float, brake: float) -> Sensed:
        """What the sensors take for the motion of the last tick; throttle behind ``throttle``."""
        self._turns += felt.v_x * self._per_turn * self._dt
        drive = self._drive(throttle, felt.v_x, brake)
        self.now = now = Now(self.now.t + self._dt, felt.v_x, motion.v_y, felt.omega, motion.eta,
                             felt.a_x, felt.a_y, felt.omega_dot, drive, self._turns)
        a_x, a_y = self._accel((felt.a_x, felt.a_y), now)
        return Sensed(self._wheel(felt.v_x, now), self._gyro(felt.omega, now), a_x, a_y)


class InjectedServo(Servo):
    """A servo with a lag, and with effects on its command and on the angle behind it."""

    def __init__(self, params: ServoParams, rng: np.random.Generator, vehicle: Vehicle,
                 dt: float, now: Callable[[], Now]) -> None:
        super().__init__(params, rng)
        self._steering = Stepper(vehicle, "steering", dt)
        self._behind = Stepper(vehicle, "angle", dt)
        self._now = now
        self._follow, self._lagging = follow(params.lag, dt), self.command
        self._play = self.linkage
        self.angle: float = self._behind(self._play, now())

    def move(self, t: float, dt: float) -> float:
        now = self._now()._replace(t=t)
        target = self._arrived(t)
        if target is not None:
            self._lagging += self._follow * (target - self._lagging)
            wanted = self._steering(self._lagging, now)
            self._play = self._turned(wanted, dt, self._play)
        self.angle = self._behind(self._play, now)
        return self.angle


def follow(lag: float, dt: float) -> float:
    """Share of the way that a first-order lag [s] goes in dt [s]."""
    return 1.0 - math.exp(-dt / lag) if lag > 0.0 else 1.0


def injected(car: HiddenCar, dt: float) -> Injected | None:
    """The effects of a car on its signals, None = it has none."""
    acts = car.servo.lag or car.esc.lag or any(a.effect.signals for a in car.vehicle.effects)
    return Injected(car, dt) if acts else None
