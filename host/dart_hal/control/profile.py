"""Reference of the speed loop: the setpoint, advanced by the response time of the car.

        target ____        a step: a ramp to it          a wave: followed directly,
              /            that the car can follow       extrapolated by its slope, so
      _______/                                           that the car is in time

A command acts with a delay. A setpoint that changes no faster than the car can is therefore
extrapolated by ``lead_time`` along its slope. A jump has no useful slope and becomes a ramp.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import sqrt

# Acceleration up to which the target is followed directly [m/s2]. A sine of 0.5 Hz and 1 m/s needs
# 3.2, the motor supplies 13 at standstill and 6 at 2.5 m/s, the tyres 8.
MAX_FOLLOWED_ACCELERATION = 4.0
# Time in which a new speed is reached [s], limited by the steepest ramp and by a ramp of at least 2
# m/s2. The 10 ms by which a PWM frame is early or late are then 3 % of a step.
STEP_DURATION = 0.40
MIN_RAMP = 2.0
# Time constant of the slope of the target [s]: two States.
SLOPE_TIME = 0.020
# Time of the first call [s]: one State.
FIRST_DT = 0.010
# Time for which the profile is stored [s]: longer than the response of any car.
HISTORY_TIME = 0.5


class Profile:
    """Call ``advance`` once per control period; it sets ``speed`` [m/s] and ``acceleration``
    [m/s2].

    ramp [m/s2]: steepest ramp to a new speed; ease [s]: time over which it ends. ``on_ramp``:
    whether the profile is on a ramp.
    """

    def __init__(self, ramp: float, ease: float) -> None:
        self._steepest = ramp
        self._ease = ease
        self.reset()

    def reset(self, speed: float = 0.0) -> None:
        """Restart at a speed [m/s] without earlier targets."""
        self.speed = speed
        self.acceleration = 0.0
        self._slope = self._t = 0.0
        self.on_ramp = True
        self._ramp = self._steepest
        self._target: float | None = None
        self._history: deque[tuple[float, float]] = deque([(0.0, speed)])

    def advance(self, target: float, dt: float, lead_time: float) -> None:
        """Advance by dt [s] towards a target [m/s] of a car that responds after lead_time [s].

        1. Slope of the target, low-passed; a jump has none.
        2. goal = target + lead_time * slope, not across zero.
        3. Move towards the goal with the largest allowed rate.
        """
        last_target = self._target
        self._target = target
        change = target - last_target if last_target is not None else 0.0
        is_followed = abs(change) <= MAX_FOLLOWED_ACCELERATION * dt
        slope = change / dt if is_followed and dt > 0.0 else 0.0
        self._slope += (slope - self._slope) * (dt / (SLOPE_TIME + dt) if is_followed else 1.0)
        goal = target + lead_time * self._slope
        if goal * target < 0.0:
            goal = 0.0
        gap = goal - self.speed
        if not is_followed or last_target is None:
            self.on_ramp = True
            self._ramp = min(max(abs(gap) / STEP_DURATION, MIN_RAMP), self._steepest)
        max_step = dt * self._rate(gap, goal)
        step = min(max(gap, -max_step), max_step)
        self.on_ramp &= step != gap
        self.speed += step
        self.acceleration = step / dt if dt > 0.0 else min(max(gap / FIRST_DT, -self._ramp),
                                                           self._ramp)
        self._t += dt
        self._history.append((self._t, self.speed))
        while self._history[0][0] < self._t - HISTORY_TIME:
            self._history.popleft()

    def _rate(self, gap: float, goal: float) -> float:
        """Return the largest rate [m/s2] towards a goal [m/s] at a distance ``gap``."""
        if not self.on_ramp:
            return MAX_FOLLOWED_ACCELERATION
        if (
            self.speed * goal < 0.0
        ):  # it still rolls in the other direction: friction helps the motor
            return 2.0 * self._ramp
        catching_up = min(self._ramp, sqrt(2.0 * self._ramp / self._ease * abs(gap)))
        return min(catching_up + abs(self._slope), max(self._steepest, MAX_FOLLOWED_ACCELERATION))

    def value_before(self, delay: float) -> float:
        """Return the profile [m/s] ``delay`` s ago."""
        t = self._t - delay
        if t <= self._history[0][0]:
            return self._history[0][1]
        for (t1, v1), (t0, v0) in pairwise(reversed(self._history)):
            if t >= t0:
                return v0 + (v1 - v0) * (t - t0) / (t1 - t0) if t1 > t0 else v1
        return self._history[-1][1]
