"""The drive train turned round: which throttle gives an acceleration, through lag and brake.

F_m(tau, v) + F_f(v) = m dv/dt is solved for the throttle tau. Where the car has to slow down
harder than it rolls out, the ESC's brake is pulled, which it offers after a pull forward.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from dart_hal.core.timing import PWM_FRAME
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.parameters import Vehicle

# Share of the motor's force at v below which no more throttle is asked for.
RESERVE = 0.2
# Throttle between the ESC's dead band (0.067 at most in hidden cars) and the motor's (0.14 at
# least): the car rolls and the ESC knows it driven forward, so that the next pull brakes.
COAST = 0.1
# N of the whole brake, as the virtual ESC has it within 10 %; of DART's it is not known.
BRAKE_FORCE = 8.0
# Of the brake: beyond the ESC's dead band.
LEAST_BRAKE = 0.09
# m/s; slower the car rolls out, for an ESC without a brake would drive it backward.
BRAKE_ABOVE = 0.25
# Throttle to add at a speed [m/s].
Correction = Callable[[float], float]


class Inverse:
    """Throttle for an acceleration by the motor and friction curves of one vehicle.

    correct(speed [m/s]): throttle that this car was measured to need beside them.
    """

    def __init__(self, vehicle: Vehicle, correct: Correction | None = None) -> None:
        self._correct = correct
        self._motor = vehicle.motor
        self.mass = vehicle.body.mass
        self._friction = make_friction(vehicle.friction)
        self.pull = self._motor.d / self.mass
        """m/s2 of the motor at standstill for all of the throttle."""

    def needed(self, speed: float, acceleration: float) -> float:
        """Force [N] that wheels need of motor or brake."""
        resisting: float = self._friction(speed)
        return self.mass * acceleration - resisting

    def motor(self, force: float, speed: float) -> float:
        """Throttle for a force [N] > 0 of the motor at ``speed`` [m/s], dead band included."""
        motor = max(self._motor.d - self._motor.e * speed, RESERVE * self._motor.d)
        more = self._correct(speed) if self._correct is not None else 0.0
        return force / motor - self._motor.g + more

    def forward(self, speed: float, acceleration: float) -> float:
        """Throttle >= 0 at a speed >= 0 [m/s]; 0 where the car slows down by itself."""
        force = self.needed(speed, acceleration)
        return max(0.0, self.motor(force, speed)) if force > 0.0 else 0.0

    def throttle(self, speed: float, acceleration: float = 0.0) -> float:
        """The same at a speed of either sign, never across neutral.

        In reverse the motor pulls ``reverse`` times as hard behind the same dead band.
        """
        if speed == 0.0 and acceleration == 0.0:
            return 0.0
        if speed >= 0.0:
            return self.forward(speed, acceleration)
        ahead = self.forward(-speed, -acceleration)
        pull = max(ahead + self._motor.g, 0.0) / self._motor.reverse
        return -(pull - self._motor.g) if ahead else 0.0

    def braked(self, speed: float, acceleration: float) -> float:
        """Throttle on the way forward, negative: the part of the brake that is needed at a
        speed [m/s]."""
        force = self.needed(speed, acceleration)
        if force > 0.0:
            return self.motor(force, speed)
        part = -force / BRAKE_FORCE
        return -part if part > LEAST_BRAKE and speed > BRAKE_ABOVE else COAST


class Lead:
    """Undoes a first-order lag between throttle and force.

    ``y`` is what the motor has of the throttle by now, of which the lag [s] is known. Asking for
    y + (u - y) / beta lets it reach u within ``horizon``; what is left is a lag of beta x lag.
    """

    def __init__(self, lag: float) -> None:
        self._lag = lag
        self.y = 0.0

    def left(self, dt: float) -> float:
        """The lag [s] that is left when called each ``dt`` s."""
        return self._lag * self._beta(dt)

    def throttle(self, wanted: float, dt: float) -> float:
        """Throttle that brings the motor to ``wanted``, on the same side of neutral."""
        if self._lag <= 0.0 or wanted == 0.0:
            return wanted
        led = self.y + (wanted - self.y) / self._beta(dt)
        return math.copysign(max(math.copysign(1.0, wanted) * led, COAST), wanted)

    def passed(self, throttle: float, dt: float) -> None:
        """``dt`` s have passed with a throttle at the motor, 0 while it brakes."""
        share = 1.0 - math.exp(-dt / self._lag) if self._lag > 0.0 else 1.0
        self.y += share * (throttle - self.y)

    def _beta(self, dt: float) -> float:
        """Half the lag as horizon asks for 2.5 times the step, and is heard as little noise."""
        horizon = max(dt, PWM_FRAME, 0.5 * self._lag)
        return 1.0 - math.exp(-horizon / self._lag) if self._lag > 0.0 else 1.0
