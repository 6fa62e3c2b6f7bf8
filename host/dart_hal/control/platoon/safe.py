"""The last word on an acceleration: from wherever it leads, the car can still stop in time.

A controller that decides each ``dt`` s and acts ``delay`` s later cannot take back what it has
sent. So the own motion is carried through the commands under way to (x, w); from there on the car
drives for one step, and then brakes. It may come as far as

    R = gap - x - e_g + max(v_p - e_v, 0)^2 / (2 b_p) - m

where the predecessor comes to rest if it brakes fully now. The largest speed w1 behind the step

    (w + w1) dt / 2 + w1^2 / (2 b_s) <= R

gives the acceleration; where even w1 = 0 goes too far, it brakes fully, to rest within the step.
What is allowed now leaves a stop for later, whatever the predecessor does: the rule needs no trust
in told accelerations. With b_p >= b_s the gap is least at rest.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import ceil, inf, sqrt


@dataclass(frozen=True, slots=True)
class Margins:
    """b_s: own brake at least, b_p: the predecessor's at most [m/s2]; e_g [m], e_v [m/s]: errors
    of gap and of the predecessor's speed at most; m [m]: what is to be left."""

    b_s: float = 1.0
    b_p: float = 1.0
    e_g: float = 0.0
    e_v: float = 0.0
    m: float = 0.02


class Underway:
    """Commands that were sent and do not act yet: ``delay`` s, in steps of ``dt`` s. brake [m/s2]:
    the car's at least, whatever was sent."""

    def __init__(self, delay: float, dt: float, v_max: float = inf, brake: float = inf) -> None:
        self._dt = dt
        self._v_max = v_max
        self._brake = brake
        n = ceil(delay / dt - 1e-9)
        self._sent: deque[float] = deque([0.0] * n, maxlen=n)
        self.delay = n * dt

    def send(self, u: float) -> None:
        """An acceleration [m/s2] is commanded for the next step."""
        self._sent.append(u)

    def through(self, speed: float) -> tuple[float, float]:
        """Way [m] and speed [m/s] when the last of them has acted."""
        way = 0.0
        for u in self._sent:
            moved, speed = moves(speed, max(u, -self._brake), self._dt, self._v_max)
            way += moved
        return way, speed


def moves(speed: float, u: float, dt: float, v_max: float = inf) -> tuple[float, float]:
    """Way [m] and speed [m/s] after dt s at an acceleration; it ends at rest and at v_max."""
    after = speed + u * dt
    end = min(max(after, 0.0), v_max)
    if end == after or u == 0.0:
        return 0.5 * (speed + end) * dt, end
    part = min((end - speed) / u, dt)
    return 0.5 * (speed + end) * part + end * (dt - part), end


def safe(gap: float, way: float, speed: float, ahead: float, dt: float, margins: Margins) -> float:
    """Largest acceleration [m/s2] for the next step; -inf: brake as hard as there is.

    way [m], speed [m/s]: of the own car through what is under way; ahead [m/s]: of the
    predecessor, as it was when the gap [m] was.
    """
    b = margins.b_s
    left = (gap - way - margins.e_g - margins.m
            + max(ahead - margins.e_v, 0.0) ** 2 / (2.0 * margins.b_p))
    square = (0.5 * b * dt) ** 2 + 2.0 * b * (left - 0.5 * speed * dt)
    then = sqrt(square) - 0.5 * b * dt if left >= 0.0 <= square else -inf
    return (then - speed) / dt if then >= 0.0 else -inf
