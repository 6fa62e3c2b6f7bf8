"""Lowest and highest speed that the throttle of the last seconds explains.

The model of the car is simulated three times:

1. ``low``: with every unknown against the car (offset of the ESC's neutral, weak battery,
   heavy load, uphill, bend).
2. ``high``: with every unknown in its favour.
3. ``free``: with the mass of the wheels only: lifted or spinning, they follow the motor.

The margins are wide as long as the car is not identified.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sin, tan

from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor_gains
from dart_hal.vehicle.parameters import GRAVITY, Vehicle

# Share of g: a ground of 5 %; that of a hall is below 1 %.
MAX_SLOPE = 0.05
# Share: payload and battery of another size.
MASS_MARGIN = 0.1
# Share: kinds of ground; the two published sets differ by 13 % at 1 m/s.
FRICTION_MARGIN = 0.2
# Share of the mass that spins with lifted wheels: they reach their speed in 0.1 s.
WHEEL_MASS_SHARE = 0.12
# s until the motor pulls: 20 ms of a PWM frame and 0.084 s of the slower set.
MOTOR_LAG = 0.1
# s of neutral between brake and reverse: the ESC's 0.1 s and two PWM frames. The first throttle
# below neutral after driving forward is the brake, and holds the car.
MIN_NEUTRAL_TIME = 0.15
# States of the ESC.
READY, FORWARD, BRAKE, REVERSE = range(4)
# m/s above which the dry friction is complete; a car at rest has all of it against it.
FULL_FRICTION_SPEED = 0.2
# m/s2 that no front axle exceeds.
MAX_LATERAL_ACCELERATION = 8.0


@dataclass(frozen=True, slots=True)
class ThrottleMargin:
    """Margins of the model.

    later, earlier: of the throttle at which the car starts to move; force: share of motor force.
    """

    later: float
    earlier: float
    force: float


# later: the recorded car, to which the model was fitted, needed 0.332 one day for the 0.35 m/s
# that the model gives it at 0.217 (25 Sep 2024): 0.115. earlier: neutral off by 10 us of 450
# (0.022) and the dead band by 5 % of 0.15 (0.0075). force: battery.
UNIDENTIFIED_MARGIN = ThrottleMargin(0.12, 0.03, 0.15)
# Neutral within 5 us after a calibration (0.011), one count (0.011), and a day.
IDENTIFIED_MARGIN = ThrottleMargin(0.04, 0.02, 0.10)


class SpeedBounds:
    """``low``, ``high``, ``free`` [m/s >= 0] along the throttle; ``advance`` once per frame.

    low: smallest speed if the car is not held; high: largest ground speed if it is not
    pushed; free: largest speed of wheels without load.
    """

    def __init__(self, vehicle: Vehicle, identified: bool) -> None:
        self._margin = IDENTIFIED_MARGIN if identified else UNIDENTIFIED_MARGIN
        self._motor_gains = make_motor_gains(vehicle.motor)
        self._friction = make_friction(vehicle.friction)
        body = vehicle.body
        self._mass = body.mass
        self._wheelbase = body.wheelbase
        self._front_load = body.mass * body.l_r / body.wheelbase
        self._reverse = vehicle.duty_motor.reverse
        self.restart()

    def restart(self) -> None:
        """Start at rest with neutral throttle."""
        self.low = self.high = self.free = 0.0
        self._esc_state = READY
        self._neutral_time = MIN_NEUTRAL_TIME
        self._lagged = 0.0

    def advance(self, throttle: float, steering: float, dt: float) -> None:
        """Simulate dt [s] with a throttle -1..1 and a road-wheel angle [rad]."""
        self._update_gear(throttle, dt)
        share = min(dt / MOTOR_LAG, 1.0)
        self._lagged += (throttle - self._lagged) * share
        least = min(abs(throttle), abs(self._lagged)) if throttle * self._lagged > 0.0 else 0.0
        most = max(abs(throttle), abs(self._lagged))
        m = self._margin
        g = self._mass * GRAVITY * MAX_SLOPE
        # 1. Least speed: uphill, in a bend, heavy, with much friction and a weak motor.
        self.low = self._step_speed(
            self.low, least - m.later, 1.0 - m.force, 1.0 + FRICTION_MARGIN,
            g + self._bend_force(self.low, steering), 1.0 + MASS_MARGIN, dt, FULL_FRICTION_SPEED)
        if self._esc_state == BRAKE:
            self.low = 0.0
        # 2. Largest speed: downhill, light, with little friction and a strong motor.
        early = most + m.earlier
        self.high = self._step_speed(self.high, early, 1.0 + m.force, 1.0 - FRICTION_MARGIN, -g,
                                     1.0 - MASS_MARGIN, dt)
        # 3. Wheels without load.
        free = self._step_speed(self.free, early, 1.0 + m.force, 1.0 - FRICTION_MARGIN, 0.0,
                                WHEEL_MASS_SHARE, dt)
        self.free = max(free, self.high)

    def _update_gear(self, throttle: float, dt: float) -> None:
        """Follow the states of the ESC: forward, brake, neutral, reverse, in this order only."""
        before = self._esc_state
        self._neutral_time = self._neutral_time + dt if throttle == 0.0 else 0.0
        if throttle > 0.0:
            self._esc_state = FORWARD
        elif throttle < 0.0:
            self._esc_state = BRAKE if before in (FORWARD, BRAKE) else REVERSE
        elif before == REVERSE or (before == BRAKE and self._neutral_time >= MIN_NEUTRAL_TIME):
            self._esc_state = READY
        if self._esc_state != before and self._esc_state != READY:
            self.low = 0.0

    def _step_speed(self, v: float, throttle: float, force: float, friction: float,
                    resistance: float, mass: float, dt: float, friction_speed: float = 0.0
                    ) -> float:
        """Return the speed after one explicit Euler step; the motor never brakes here."""
        k0, k1 = self._motor_gains(max(throttle, 0.0))
        if self._esc_state == REVERSE:
            k0 = k0 * self._reverse
            k1 = k1 * self._reverse
        drive = max((k0 - k1 * v) * force, 0.0)
        drag = -self._friction(max(v, friction_speed)) * friction
        after: float = v + dt * (drive - drag - resistance) / (mass * self._mass)
        return max(after, 0.0)

    def _bend_force(self, v: float, steering: float) -> float:
        """Return the part of the motor force that the front tyres absorb in a bend [N]."""
        lateral = min(v * v * abs(tan(steering)) / self._wheelbase, MAX_LATERAL_ACCELERATION)
        return self._front_load * lateral * abs(sin(steering))
