"""Slowest and fastest speed that the throttle of the last seconds explains.

The model of the car's files, run twice: once with everything against the car
that may be (offset of the ESC's neutral, weak battery, heavy load, uphill,
bend), once with everything for it. A third run has no mass but the wheels':
lifted or spinning, they follow the motor. The margins are wide as long as
nobody has identified this car.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sin, tan

from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor_gains
from dart_hal.vehicle.parameters import GRAVITY, Vehicle

SLOPE = 0.05
"""Of g: a floor of 5 %; a hall's is below 1 %."""
MASS = 0.1
"""Share: payload and battery of another size."""
FRICTION = 0.2
"""Share: floors; the two published sets are 13 % apart at 1 m/s."""
WHEELS = 0.12
"""Share of the mass that spins with lifted wheels: they reach their speed in 0.1 s."""
LAG = 0.1
"""s until the motor pulls: 20 ms of a PWM frame and 0.084 s of the slower set."""
NEUTRAL = 0.15
"""s of neutral between the brake and reverse: the ESC's 0.1 s and two PWM frames. The first
pull below neutral after a drive forward is the brake, and holds the car."""
READY, FORWARD, BRAKE, REVERSE = range(4)
"""What the ESC makes of a pull."""
ROLLS = 0.2
"""m/s from which on the dry friction is whole; a standing car has all of it against it."""
GRIP = 8.0
"""m/s2 of lateral acceleration that no front axle passes."""


@dataclass(frozen=True, slots=True)
class Margin:
    """Of the throttle at which the car moves: later, earlier; force: share of the pull."""

    later: float
    earlier: float
    force: float


UNKNOWN = Margin(0.12, 0.03, 0.15)
"""later: the recorded car, which the model was fitted to, needed 0.332 one day for the
0.35 m/s that the model gives it at 0.217 (25 Sep 2024): 0.115. earlier: neutral off by
10 us of 450 (0.022) and the dead band by 5 % of 0.15 (0.0075). force: battery."""
IDENTIFIED = Margin(0.04, 0.02, 0.10)
"""Neutral within 5 us after a calibration (0.011), a whole count (0.011), and a day."""


class SpeedBounds:
    """``low``, ``high``, ``free`` [m/s >= 0] along the throttle; ``advance`` once per frame.

    low: at least this fast, if nothing holds the car; high: the ground speed at
    most, if nobody pushes it; free: wheels that carry nothing.
    """

    def __init__(self, vehicle: Vehicle, identified: bool) -> None:
        self._margin = IDENTIFIED if identified else UNKNOWN
        self._gains = make_motor_gains(vehicle.motor)
        self._friction = make_friction(vehicle.friction)
        body = vehicle.body
        self._mass, self._wheelbase = body.mass, body.wheelbase
        self._front = body.mass * body.l_r / body.wheelbase
        self._reverse = vehicle.motor.reverse
        self.restart()

    def restart(self) -> None:
        """The car stands at neutral."""
        self.low = self.high = self.free = 0.0
        self._gear, self._rested, self._pull = READY, NEUTRAL, 0.0

    def advance(self, throttle: float, steering: float, dt: float) -> None:
        """dt [s] more with a throttle -1..1 and a road-wheel angle [rad]."""
        self._shift(throttle, dt)
        share = min(dt / LAG, 1.0)
        self._pull += (throttle - self._pull) * share
        surely = min(abs(throttle), abs(self._pull)) if throttle * self._pull > 0.0 else 0.0
        at_most = max(abs(throttle), abs(self._pull))
        m, g = self._margin, self._mass * GRAVITY * SLOPE
        self.low = self._step(self.low, surely - m.later, 1.0 - m.force, 1.0 + FRICTION,
                              g + self._bend(self.low, steering), 1.0 + MASS, dt, ROLLS)
        if self._gear == BRAKE:
            self.low = 0.0
        easy = at_most + m.earlier
        self.high = self._step(self.high, easy, 1.0 + m.force, 1.0 - FRICTION, -g, 1.0 - MASS, dt)
        self.free = max(self._step(self.free, easy, 1.0 + m.force, 1.0 - FRICTION, 0.0, WHEELS,
                                   dt), self.high)

    def _shift(self, throttle: float, dt: float) -> None:
        """Forward, brake, neutral, reverse: in this order only."""
        before = self._gear
        self._rested = self._rested + dt if throttle == 0.0 else 0.0
        if throttle > 0.0:
            self._gear = FORWARD
        elif throttle < 0.0:
            self._gear = BRAKE if before in (FORWARD, BRAKE) else REVERSE
        elif before == REVERSE or (before == BRAKE and self._rested >= NEUTRAL):
            self._gear = READY
        if self._gear != before and self._gear != READY:
            self.low = 0.0

    def _step(self, v: float, throttle: float, force: float, friction: float, against: float,
              mass: float, dt: float, rolls: float = 0.0) -> float:
        """One explicit step; the motor never brakes here."""
        k0, k1 = self._gains(max(throttle, 0.0))
        if self._gear == REVERSE:
            k0, k1 = k0 * self._reverse, k1 * self._reverse
        pull = max((k0 - k1 * v) * force, 0.0)
        drag = -self._friction(max(v, rolls)) * friction
        after: float = v + dt * (pull - drag - against) / (mass * self._mass)
        return max(after, 0.0)

    def _bend(self, v: float, steering: float) -> float:
        """What the front tyres take from the pull [N]."""
        lateral = min(v * v * abs(tan(steering)) / self._wheelbase, GRIP)
        return self._front * lateral * abs(sin(steering))
