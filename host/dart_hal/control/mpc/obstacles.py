"""Obstacles beside a path, as bounds of the error across at each stage.

    e_c >= e_o + R - RAMP max(|s - s_o| - L, 0)      passed on its left, the mirror on its right

A corridor that narrows along a ramp: one that is there or is not makes the plan jump. The side is
chosen once for an encounter, that with more room.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from dart_hal.types import FloatArray

RAMP = 0.4
"""m across for 1 m along: at 2 m/s within the curvature that the car turns."""
HALF_WIDTH, MARGIN = 0.10, 0.10
"""m of the body (0.3 x 0.2 m), and beyond: the corners of a body that is turned by 0.2 rad reach
3 cm further, a controller errs by 2."""
BESIDE = 0.05
"""m of way more than R for which the whole distance is kept."""
SEEN = 3.0
"""m ahead at which a side is chosen: 1.5 s at 2 m/s."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A disc: s, offset [m] of its middle along and beside the path, radius [m]; speed [m/s]
    along the path; s is where it is at time t [s]."""

    s: float
    offset: float
    radius: float
    speed: float = 0.0
    t: float = 0.0


class Corridor:
    """The lane [m] to either side, less what obstacles take of it."""

    def __init__(self, lane: float, length: float = inf) -> None:
        """length [m]: of a closed path, on which an obstacle is met once a lap."""
        self.lane, self._length = lane, length
        self.obstacles: tuple[Obstacle, ...] = ()
        self.blocked = False
        self._sides: dict[Obstacle, float] = {}

    def bounds(self, s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(low, high) [m] of the error across for the car's middle at progresses s [m], times t.

        ``blocked`` tells then whether there is no way anywhere; low is above high there.
        """
        low, high = np.full(len(s), -self.lane), np.full(len(s), self.lane)
        for o in self.obstacles:
            at = o.s + o.speed * (t - o.t)
            apart = s - at
            if np.isfinite(self._length):
                apart = apart - self._length * np.round(apart / self._length)
            side = self._side(o, float(apart[0]))
            if not side:
                continue
            clear = o.radius + HALF_WIDTH + MARGIN
            edge = side * o.offset + clear - RAMP * np.maximum(np.abs(apart) - clear - BESIDE, 0.0)
            if side > 0.0:
                low = np.maximum(low, edge)
            else:
                high = np.minimum(high, -edge)
        self.blocked = bool((low > high).any())
        return low, high

    def _side(self, o: Obstacle, apart: float) -> float:
        """1: passed on its left, -1: on its right, 0: far away."""
        if not -SEEN < apart < 1.0:
            self._sides.pop(o, None)
            return 0.0
        return self._sides.setdefault(o, 1.0 if o.offset <= 0.0 else -1.0)
