"""Inverse of the drive train: the throttle for an acceleration, through lag and brake.

F_m(tau, v) + F_f(v) = m dv/dt is solved for the throttle tau. If the car has to decelerate harder
than it rolls out, the ESC's brake is used, which is available after driving forward.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from dart_hal.core.timing import PWM_FRAME
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.parameters import Vehicle

# Smallest motor force at v relative to that at rest, for which the throttle is computed.
MIN_MOTOR_SHARE = 0.2
# Throttle between the dead band of the ESC (at most 0.067 in hidden cars) and that of the motor (at
# least 0.14): the car rolls, and the ESC registers driving forward, so that the next negative pulse
# brakes.
COAST_THROTTLE = 0.1
# What the full brake adds to the deceleration [m/s2] of a car on which it was not measured: 8 N of
# the virtual ESC at 1.67 kg; that of DART is unknown.
DEFAULT_BRAKE = 4.8
# Smallest part of the brake: beyond the dead band of the ESC.
MIN_BRAKE_SHARE = 0.09
# Minimum speed for braking [m/s]; below it the car rolls out, because an ESC without a brake would
# drive backward.
MIN_BRAKING_SPEED = 0.25
# Function of the speed [m/s]: throttle to add.
Correction = Callable[[float], float]


class InverseDrive:
    """Throttle for an acceleration by the motor and friction curves of one vehicle.

    correct(speed [m/s]): measured throttle of this car minus that of the curves. brake [m/s2]: what
    a throttle of -1 adds to the deceleration.
    """

    def __init__(self, vehicle: Vehicle, correct: Correction | None = None,
                 brake: float = DEFAULT_BRAKE) -> None:
        self._correct = correct
        self._full_brake = brake * vehicle.body.mass
        self._motor = vehicle.duty_motor
        self.mass = vehicle.body.mass
        self._friction = make_friction(vehicle.friction)
        self.pull = self._motor.d / self.mass
        """m/s2 of the motor at standstill for all of the throttle."""

    def required_force(self, speed: float, acceleration: float) -> float:
        """Return the force [N] that motor or brake must supply."""
        resisting: float = self._friction(speed)
        return self.mass * acceleration - resisting

    def motor(self, force: float, speed: float) -> float:
        """Return the throttle for a motor force [N] > 0 at ``speed`` [m/s], dead band included."""
        motor = max(self._motor.d - self._motor.e * speed, MIN_MOTOR_SHARE * self._motor.d)
        correction = self._correct(speed) if self._correct is not None else 0.0
        return force / motor - self._motor.g + correction

    def forward(self, speed: float, acceleration: float) -> float:
        """Return the throttle >= 0 at a speed >= 0 [m/s]; 0 if the car decelerates without motor.
        """
        force = self.required_force(speed, acceleration)
        return max(0.0, self.motor(force, speed)) if force > 0.0 else 0.0

    def throttle(self, speed: float, acceleration: float = 0.0) -> float:
        """Return the throttle at a speed of either sign, never across neutral.

        In reverse the motor force is ``reverse`` times as large, with the same dead band.
        """
        if speed == 0.0 and acceleration == 0.0:
            return 0.0
        if speed >= 0.0:
            return self.forward(speed, acceleration)
        mirrored = self.forward(-speed, -acceleration)
        magnitude = max(mirrored + self._motor.g, 0.0) / self._motor.reverse
        return -(magnitude - self._motor.g) if mirrored else 0.0

    def throttle_or_brake(self, speed: float, acceleration: float) -> float:
        """Return the throttle while driving forward; negative: the required part of the brake at a
        speed [m/s].
        """
        force = self.required_force(speed, acceleration)
        if force > 0.0:
            return self.motor(force, speed)
        part = -force / self._full_brake if self._full_brake > 0.0 else 0.0
        return -part if part > MIN_BRAKE_SHARE and speed > MIN_BRAKING_SPEED else COAST_THROTTLE


class LagCompensator:
    """Compensation of the first-order lag between throttle and force.

    ``filtered`` is the throttle after the known lag [s]. The command y + (u - y) / beta makes y
    reach u within a horizon; the lag that remains is beta * lag.
    """

    def __init__(self, lag: float) -> None:
        self._lag = lag
        self.filtered = 0.0

    def remaining_lag(self, dt: float) -> float:
        """Return the remaining lag [s] when called every ``dt`` s."""
        return self._lag * self._beta(dt)

    def throttle(self, target: float, dt: float) -> float:
        """Return the throttle that brings the motor to ``target``, on the same side of neutral."""
        if self._lag <= 0.0 or target == 0.0:
            return target
        compensated = self.filtered + (target - self.filtered) / self._beta(dt)
        return math.copysign(max(math.copysign(1.0, target) * compensated, COAST_THROTTLE), target)

    def record(self, throttle: float, dt: float) -> None:
        """Record the throttle at the motor for the last ``dt`` s, 0 while it brakes."""
        share = 1.0 - math.exp(-dt / self._lag) if self._lag > 0.0 else 1.0
        self.filtered += share * (throttle - self.filtered)

    def _beta(self, dt: float) -> float:
        """Return beta = 1 - exp(-horizon / lag).

        A horizon of half the lag overdrives a step by a factor of 2.5 and amplifies noise little.
        """
        horizon = max(dt, PWM_FRAME, 0.5 * self._lag)
        return 1.0 - math.exp(-horizon / self._lag) if self._lag > 0.0 else 1.0
