"""The speed that the car is to have, ahead by the time that it takes to answer.

        wanted ____        a step: a ramp to it          a wave: followed as it is,
              /            the car can follow            taken further by its slope,
      _______/                                           so that the car is in time

A command acts a little later. What changes no faster than the car can is therefore taken
``ahead`` along its own slope; a jump says nothing about what comes, and is a ramp from now on.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import sqrt

# m/s2 up to which what is wanted is followed as it is. A sine of 0.5 Hz and 1 m/s needs 3.2, the
# motor gives 13 at standstill and 6 at 2.5 m/s, the tyres 8.
FOLLOWED = 4.0
# s in which a new speed is reached, if that is no steeper than the car can, and no flatter than 2
# m/s2. 10 ms, by which a PWM frame is early or late, are then 3 % of a step.
WITHIN = 0.40
SLOWEST = 2.0
# s over which the slope of what is wanted is taken: two States.
SLOPE_OVER = 0.020
# s, one State: what the first call, which has no time behind it, is taken for.
START = 0.010
# s of the profile that are kept: more than any car takes to answer.
LONGEST = 0.5


class Profile:
    """Call ``go`` once per control period; ``speed`` [m/s] and ``acceleration`` [m/s2] follow.

    ramp [m/s2]: the steepest way to a new speed; ease [s] over which it ends. ``jumping``: on it.
    """

    def __init__(self, ramp: float, ease: float) -> None:
        self._steepest = ramp
        self._ease = ease
        self.reset()

    def reset(self, speed: float = 0.0) -> None:
        """Begin anew at a speed [m/s]; nothing is known of what was wanted."""
        self.speed = speed
        self.acceleration = 0.0
        self._slope = self._t = 0.0
        self.jumping = True
        self._ramp = self._steepest
        self._wanted: float | None = None
        self._kept: deque[tuple[float, float]] = deque([(0.0, speed)])

    def go(self, wanted: float, dt: float, ahead: float) -> None:
        """``dt`` s later a speed [m/s] is wanted; the car answers ``ahead`` s late."""
        before = self._wanted
        self._wanted = wanted
        change = wanted - before if before is not None else 0.0
        followed = abs(change) <= FOLLOWED * dt
        slope = change / dt if followed and dt > 0.0 else 0.0
        self._slope += (slope - self._slope) * (dt / (SLOPE_OVER + dt) if followed else 1.0)
        target = wanted + ahead * self._slope
        if target * wanted < 0.0:
            target = 0.0
        gap = target - self.speed
        if not followed or before is None:
            self.jumping = True
            self._ramp = min(max(abs(gap) / WITHIN, SLOWEST), self._steepest)
        most = dt * self._rate(gap, target)
        step = min(max(gap, -most), most)
        self.jumping &= step != gap
        self.speed += step
        self.acceleration = step / dt if dt > 0.0 else min(max(gap / START, -self._ramp),
                                                           self._ramp)
        self._t += dt
        self._kept.append((self._t, self.speed))
        while self._kept[0][0] < self._t - LONGEST:
            self._kept.popleft()

    def _rate(self, gap: float, target: float) -> float:
        """m/s2 at which the profile may go to a target [m/s] that is ``gap`` away."""
        if not self.jumping:
            return FOLLOWED
        if self.speed * target < 0.0:  # it rolls the other way yet: motor and friction help
            return 2.0 * self._ramp
        catching_up = min(self._ramp, sqrt(2.0 * self._ramp / self._ease * abs(gap)))
        return min(catching_up + abs(self._slope), max(self._steepest, FOLLOWED))

    def before(self, late: float) -> float:
        """The profile [m/s] as it was ``late`` s ago."""
        t = self._t - late
        if t <= self._kept[0][0]:
            return self._kept[0][1]
        for (t1, v1), (t0, v0) in pairwise(reversed(self._kept)):
            if t >= t0:
                return v0 + (v1 - v0) * (t - t0) / (t1 - t0) if t1 > t0 else v1
        return self._kept[-1][1]
