"""Steering servo and linkage: pulse width in, road-wheel angle out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dart_hal.vehicle import PAPER, Steering, make_steering
from dart_hal.vehicle.delay import DelayQueue
from dart_lab.sim.pwm_output import Pulse

# A servo of this class turns 180 deg for 2000 us.
HORN_RAD_PER_US = math.pi / 2 / 1000.0


@dataclass(frozen=True, slots=True)
class ServoParams:
    """Linkage: ``curve`` at command = (pulse - center_us) / span_us, then backlash.

    ``rate`` of the horn [rad/s]; ``delay`` [s] from pulse to motion, then a
    first-order ``lag`` [s] (``injected.InjectedServo`` has one);
    ``backlash`` [rad] is the full width of the loop at the road wheels;
    ``repeatability`` [us] is one sigma of where the servo comes to rest: its
    potentiometer and friction give another position after every move.
    """

    center_us: float = 1500.0
    span_us: float = 375.0
    curve: Steering = field(default_factory=lambda: PAPER.steering)
    rate: float = 6.0
    delay: float = 0.0
    backlash: float = 0.0
    repeatability: float = 0.0
    lag: float = 0.0


# Command at which the horn is at its stop.
MAX_COMMAND = 1.3

# Smallest change of the command (7.5 us) that overcomes friction and is a new move.
MIN_MOVE = 0.02


class SteeringServo:
    """Horn position (as command) and road-wheel angle [rad], moved in ticks.

    Without pulses the servo keeps its position. The linkage has play: the road wheel follows it
    within a band of width ``backlash`` around the curve.
    """

    def __init__(self, params: ServoParams, rng: np.random.Generator | None = None) -> None:
        self.params = params
        self._rng = rng or np.random.default_rng(0)
        self._spread = params.repeatability / params.span_us
        self._rest = 0.0
        self._moved_to = 0.0
        self.command = 0.0
        self._curve = make_steering(params.curve)
        self.linkage: float = self._curve(0.0)
        self.angle: float = self.linkage
        self._rate = params.rate / (HORN_RAD_PER_US * params.span_us)
        self._target: float | None = None
        self._pending = DelayQueue[float]()

    def pulse(self, pulse: Pulse) -> None:
        """Take over one complete pulse (rise, fall) [s]."""
        rise, t = pulse
        width = (t - rise) * 1e6
        # A servo ignores pulses of other widths.
        if 400.0 <= width <= 2600.0:
            command = (width - self.params.center_us) / self.params.span_us
            if abs(command - self._moved_to) > MIN_MOVE:
                self._moved_to = command
                self._rest = self._spread * float(self._rng.normal())
            self._pending.put(t + self.params.delay, command + self._rest)

    def move(self, t: float, dt: float) -> float:
        """Advance by dt up to world time t and return the road-wheel angle [rad]."""
        target = self._current_target(t)
        if target is not None and target != self.command:
            self.angle = self._turn_linkage(target, dt, self.angle)
        return self.angle

    def _current_target(self, t: float) -> float | None:
        """Return the command that acts at time t, None = no pulse yet."""
        for command in self._pending.take(t):
            self._target = command
        return self._target

    def _turn_linkage(self, target: float, dt: float, angle: float) -> float:
        """Turn the horn for dt towards a command; return the angle [rad] behind the linkage."""
        max_step = self._rate * dt
        self.command += max(-max_step, min(max_step, target - self.command))
        self.linkage = middle = self._curve(max(-MAX_COMMAND, min(MAX_COMMAND, self.command)))
        # The road wheel keeps its angle until the edge of the play moves it.
        half = 0.5 * self.params.backlash
        moved: float = max(middle - half, min(middle + half, angle))
        return moved
