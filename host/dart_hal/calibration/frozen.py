"""A speed kept by pulses that stand still, while it is measured where the ring's edges are.

A wheel whose speed swings once a turn looks like a ring with uneven marks. A speed loop makes it
swing, for it answers the marks; so do the counts of the PCA9685, for at 0.4 m/s the ring turns
once in five of its frames, and the pattern of rounded pulses meets the same marks again and again.
A whole number of counts does neither.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from dart_hal.core.config import CarFiles
from dart_hal.core.types import State
from dart_hal.devices.actuation.quantiser import counter_of
from dart_hal.vehicle.sets import PAPER

AVERAGED = 40
"""Frames, four turns of the ring, over which speed and pulse are averaged."""
REACHED = 0.9
"""Of the speed, from which the pulse is frozen."""
RETURNS, ANOTHER = 0.7, 0.75
"""s in which a speed shall come back to what it should be, and counts that are missing for that
from which on they are given: with half a count the car would go up and down in steps."""
ANSWERED = 0.15
"""s after another pulse in which intervals do not count: two PWM frames, the ESC, and the eight
intervals of a frame."""


class Frozen:
    """The throttle's pulse of one roll: whole counts, seldom another, so that a speed is kept.

    One count changes the acceleration by 0.17 m/s2, so a speed between two of them goes up and
    down with both in turn, over seconds.
    """

    def __init__(self, files: CarFiles, speed: float) -> None:
        self.pulse_us: float | None = None
        self._since = math.inf
        self._count, self._speed = counter_of(files)[1], speed
        self._per_count = (PAPER.motor.d - PAPER.motor.e * speed) / PAPER.body.mass * (
            self._count / files.config.throttle.span_us)
        self._recent: deque[State] = deque(maxlen=AVERAGED)

    def see(self, state: State) -> float | None:
        """The pulse [us] to hold after this State, None until the car has its speed."""
        recent = self._recent
        recent.append(state)
        if len(recent) < AVERAGED:
            return self.pulse_us
        speeds = np.array([s.speed for s in recent]).reshape(2, -1).mean(axis=1)
        gained = (speeds[1] - speeds[0]) / (0.5 * (recent[-1].t - recent[0].t))
        wanted = (self._speed - speeds.mean()) / RETURNS
        counts = (wanted - gained) / self._per_count
        if self.pulse_us is None and speeds.mean() > REACHED * self._speed:
            self._hold(float(np.mean([s.applied.throttle_us for s in recent])), counts, state.t)
        elif self.pulse_us is not None and abs(counts) > ANOTHER:
            self._hold(self.pulse_us, counts, state.t)
        return self.pulse_us

    def steady(self, t: float) -> bool:
        """Whether the intervals that came by t [s] are of one pulse."""
        return t - self._since > ANSWERED

    def _hold(self, pulse_us: float, counts: float, t: float) -> None:
        self._since = t
        self.pulse_us = round(pulse_us / self._count + counts) * self._count
        self._recent.clear()
