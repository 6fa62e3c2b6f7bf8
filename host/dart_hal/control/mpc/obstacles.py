"""Obstacles beside a path, as bounds of the error across at each stage.

    e_c >= e_o + R - RAMP max(|s - s_o| - L, 0)      passed on its left, the mirror on its right

A corridor that narrows along a ramp: one that is there or is not makes the plan jump. The side is
chosen once for an encounter, that with more room.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, sin

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray

# m across for 1 m along: at 2 m/s within the curvature that the car turns.
RAMP = 0.4
# m of the body, and beyond: 5 cm of air; 2.5 for the corners of a body that is turned by 0.17
# rad; 1.5 by which a bend of 0.75 m leaves its straight side (0.15^2 / 1.5 m); three of the 1.0
# cm by which a car with 1 cm of pose noise errs there, as two of them are passed once in fifty.
HALF_LENGTH = 0.15
HALF_WIDTH = 0.10
MARGIN = 0.12
# m of way more than R for which the whole distance is kept.
BESIDE = 0.05
# m ahead at which a side is chosen: 1.5 s at 2 m/s.
SEEN = 3.0


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A disc: s, offset [m] of its middle along and beside the path, radius [m]; speed [m/s]
    along the path; s is where it is at time t [s]."""

    s: float
    offset: float
    radius: float
    speed: float = 0.0
    t: float = 0.0


@dataclass(frozen=True, slots=True)
class Disc:
    """x, y, radius [m] of a disc in the frame of the poses; speed [m/s] along the path."""

    x: float
    y: float
    radius: float
    speed: float = 0.0

    def beside(self, path: Path, t: float) -> Obstacle:
        """It, at time t [s], beside the nearest point of a path, which goes on behind its ends."""
        near = float(path.s[np.argmin(np.hypot(path.x - self.x, path.y - self.y))])
        s = path.closest(self.x, self.y, near)
        spot = path.at(s)
        s += cos(spot.heading) * (self.x - spot.x) + sin(spot.heading) * (self.y - spot.y)
        return Obstacle(s, path.offset(self.x, self.y, s), self.radius, self.speed, t)


def needed(o: Obstacle) -> float:
    """m beside the path that the car has to go to pass it on the side with more room."""
    return o.radius + HALF_WIDTH + MARGIN - abs(o.offset)


def air(x: float, y: float, yaw: float, o: Obstacle, path: Path, t: float) -> float:
    """m between the body, with its middle at x, y [m], and an obstacle at t [s]; negative inside
    it."""
    spot = path.at(o.s + o.speed * (t - o.t))
    away_x = spot.x - o.offset * sin(spot.heading) - x
    away_y = spot.y + o.offset * cos(spot.heading) - y
    along = abs(away_x * cos(yaw) + away_y * sin(yaw)) - HALF_LENGTH
    across = abs(away_y * cos(yaw) - away_x * sin(yaw)) - HALF_WIDTH
    apart = hypot(max(along, 0.0), max(across, 0.0)) + min(max(along, across), 0.0)
    return apart - o.radius


class Corridor:
    """The lane [m] to either side, less what obstacles take of it."""

    def __init__(self, lane: float, length: float = inf) -> None:
        """length [m]: of a closed path, on which an obstacle is met once a lap."""
        self.lane = lane
        self._length = length
        self._obstacles: tuple[Obstacle, ...] = ()
        self.blocked = False
        self._sides: dict[Obstacle, float] = {}

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What takes of it; may be set at any time."""
        return self._obstacles

    @obstacles.setter
    def obstacles(self, obstacles: tuple[Obstacle, ...]) -> None:
        self._obstacles = obstacles
        self._sides = {o: side for o, side in self._sides.items() if o in obstacles}

    def bounds(self, s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(low, high) [m] of the error across for the car's middle at progresses s [m], times t.

        ``blocked`` tells then whether there is no way anywhere; low is above high there.
        """
        low = np.full(len(s), -self.lane)
        high = np.full(len(s), self.lane)
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
