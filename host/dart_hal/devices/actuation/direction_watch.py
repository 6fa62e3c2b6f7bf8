"""Detection of a car that speeds up against its throttle.

The leads of the motor are swapped, or the IMU, which gives the direction of travel, is turned by
180 degrees. A speed loop would then raise the throttle the more, the faster the car goes.

    against: the measured speed has the sign opposite to the throttle at the pin
    rise <- max(rise + change of |speed| - 0.25 m/s2 * dt, 0), one for each sign of the throttle;
            it grows under a throttle of its sign only
    against, with a rise above 0.2 m/s: it speeds up against its throttle

A car that reverses comes to rest first, where every rise is zero. What it gains at neutral, on a
slope, is no rise; pauses of the throttle do not end one. A throttle below neutral is the brake of
an ESC as long as the car has not come to rest: downhill the car may speed up under it.
"""

from __future__ import annotations

import math

# m/s: the direction is known after a change of 0.25 m/s within 0.4 s.
MIN_SPEED_RISE = 0.2
# m/s2: an old rise is forgotten, so that a sign that is wrong for a moment at a constant speed is
# none. A motor with a throttle beyond its dead band accelerates the car by 1 m/s2 and more.
FORGETTING_RATE = 0.25
# m/s: below this the car has come to rest, and a pulse below neutral is no longer a brake.
MAX_REST_SPEED = 0.05


class DirectionWatch:
    """Compares speed and throttle; ``update`` once per State."""

    def __init__(self) -> None:
        self._rises = {1: 0.0, -1: 0.0}
        self._size = math.inf
        self._t = 0.0
        self._has_rested = False

    def update(self, t: float, speed: float, throttle: float) -> bool:
        """Return whether the car speeds up against its throttle.

        t [s] and speed [m/s] of the State, forward positive; throttle [-1..1]: at the pin.
        """
        size = abs(speed)
        sign = (throttle > 0.0) - (throttle < 0.0)
        change = size - self._size
        forgotten = FORGETTING_RATE * max(t - self._t, 0.0)
        for side, rise in self._rises.items():
            counted = change if side == sign else min(change, 0.0)
            self._rises[side] = max(rise + counted - forgotten, 0.0)
        self._size = size
        self._t = t
        if sign > 0:
            self._has_rested = False
        elif sign < 0:
            self._has_rested |= size < MAX_REST_SPEED
        against = sign * speed < 0.0 and (sign > 0 or self._has_rested)
        return against and self._rises[sign] > MIN_SPEED_RISE
