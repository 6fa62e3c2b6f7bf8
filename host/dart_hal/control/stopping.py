"""Slowing down to rest, by a ramp and a time in which the car has to stand; and one that stands
though it is asked to drive."""

from __future__ import annotations

from math import inf

from dart_hal.control.lap import CRAWL
from dart_hal.core.types import MotionEstimate

# m/s2 of a stop, and of a car that rolls out from a crawl (1.0 on the paper's car).
SLOWS = 2.0
ROLLS = 0.8
# m/s and s: the car stands.
RESTS = 0.03
RESTS_FOR = 0.2
# s at neutral in which it has to stand: a car whose brake does nothing rolls out from 2 m/s in
# 2.5 s. One that does not is downhill, or pushed, and no program makes it stop.
WITHIN = 3.0

# s in which a car that is asked to drive has to move, of at most so many for one answer: arming
# takes 2 s, in which nothing is asked. A motor that is held pulls its largest current.
STUCK = 3.0
ANSWER = 0.1


class Standing:
    """How long a car that is asked to drive has stood [s]; once per answer."""

    def __init__(self) -> None:
        self._t = inf
        self._stood = 0.0

    def stuck(self, t: float, speed: float) -> bool:
        """Whether that is too long, at t [s] and a speed [m/s]."""
        dt = min(max(t - self._t, 0.0), ANSWER)
        self._t = t
        self._stood = self._stood + dt if abs(speed) < RESTS else 0.0
        return self._stood > STUCK


class Stopping:
    """A stop from ``speed`` [m/s] asked for at ``t`` [s]. ``over``: at rest, or given up."""

    def __init__(self, speed: float, t: float) -> None:
        self.over = False
        self.rolls = ""
        """Why it is given up; empty while it is not."""
        self._speed = speed
        self._t = t
        self._rested = self._neutral = 0.0

    def speed(self, motion: MotionEstimate) -> float:
        """Speed to ask for [m/s]; 0 is neutral. It falls with every answer, so it ends."""
        dt = motion.t - self._t
        self._t = motion.t
        speed = max(min(self._speed, max(motion.speed, 0.0)) - SLOWS * dt, 0.0)
        self._speed = speed if speed > CRAWL else 0.0
        self._rested = self._rested + dt if abs(motion.speed) < RESTS else 0.0
        self._neutral += 0.0 if self._speed else dt
        if self._rested > RESTS_FOR:
            self.over = True
        elif self._neutral > WITHIN:
            self.over = True
            self.rolls = f"it still rolls at {motion.speed:.2f} m/s, {WITHIN:g} s after neutral"
        return self._speed
