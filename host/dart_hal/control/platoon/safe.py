"""Safety filter of an acceleration: whatever it leads to, the car can still stop in time.

A controller that decides each ``dt`` s and acts ``delay`` s later cannot revoke its last commands.
The own motion is therefore predicted through these commands to (x, w); then the car drives for one
step and brakes. It may come as far as

    R = gap - x - e_g + max(v_p - e_v, 0)^2 / (2 b_p) - m

where the predecessor comes to rest if it brakes fully now. The largest speed w1 after the step

    (w + w1) dt / 2 + w1^2 / (2 b_s) <= R

gives the acceleration; if even w1 = 0 goes too far, the car brakes fully, to rest within the step.
An acceleration that is allowed now permits a stop later, whatever the predecessor does: the rule
does not rely on reported accelerations. With b_p >= b_s the gap is smallest at rest.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import ceil, inf, sqrt


@dataclass(frozen=True, slots=True)
class SafetyMargins:
    """b_s: smallest own deceleration, b_p: largest of the predecessor [m/s2]; e_g [m], e_v [m/s]:
    largest errors of the gap and of the predecessor's speed; m [m]: gap that must remain.
    """

    b_s: float = 1.0
    b_p: float = 1.0
    e_g: float = 0.0
    e_v: float = 0.0
    m: float = 0.02


class PendingCommands:
    """Commands that do not act yet: ``delay`` s, in steps of ``dt`` s.

    brake [m/s2]: largest deceleration of the car, whatever was commanded.
    """

    def __init__(self, delay: float, dt: float, v_max: float = inf, brake: float = inf) -> None:
        self._dt = dt
        self._v_max = v_max
        self._brake = brake
        n = ceil(delay / dt - 1e-9)
        self._pending: deque[float] = deque([0.0] * n, maxlen=n)
        self.delay = n * dt

    def send(self, u: float) -> None:
        """Append an acceleration [m/s2] for the next step."""
        self._pending.append(u)

    def predict(self, speed: float) -> tuple[float, float]:
        """Return distance [m] and speed [m/s] after the last pending command."""
        distance = 0.0
        for u in self._pending:
            travel, speed = integrate_motion(speed, max(u, -self._brake), self._dt, self._v_max)
            distance += travel
        return distance, speed


def integrate_motion(speed: float, u: float, dt: float, v_max: float = inf) -> tuple[float, float]:
    """Return distance [m] and speed [m/s] after dt s at an acceleration, which ends at rest and
    v_max.
    """
    unlimited = speed + u * dt
    end = min(max(unlimited, 0.0), v_max)
    if end == unlimited or u == 0.0:
        return 0.5 * (speed + end) * dt, end
    duration = min((end - speed) / u, dt)
    return 0.5 * (speed + end) * duration + end * (dt - duration), end


def safe_acceleration(
    gap: float,
    distance: float,
    speed: float,
    predecessor_speed: float,
    dt: float,
    margins: SafetyMargins,
) -> float:
    """Return the largest safe acceleration [m/s2] for the next step; -inf: brake as hard as
    possible.

    distance [m], speed [m/s]: of the own car after the pending commands; predecessor_speed [m/s]:
    at the time of the gap [m].
    """
    b = margins.b_s
    stopping_distance = (gap - distance - margins.e_g - margins.m
                         + max(predecessor_speed - margins.e_v, 0.0) ** 2 / (2.0 * margins.b_p))
    square = (0.5 * b * dt) ** 2 + 2.0 * b * (stopping_distance - 0.5 * speed * dt)
    next_speed = sqrt(square) - 0.5 * b * dt if stopping_distance >= 0.0 <= square else -inf
    return (next_speed - speed) / dt if next_speed >= 0.0 else -inf


# Name of version 0.1.
Margins = SafetyMargins
