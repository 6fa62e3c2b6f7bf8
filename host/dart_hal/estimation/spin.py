"""Whether wheels spin or lock: their speed beside what the accelerometer says that the car does.

The ground's speed is integrated from the acceleration and pulled to that of the wheels, so that a
bias of the accelerometer stays small; how far the IMU is off the axle is learnt in turns. Where
both part, the wheels are not believed for as long as the integral is any good.
"""

from __future__ import annotations

from collections import deque

WINDOW = 4
"""Steps over which speeds are compared: edges of the ring come unevenly."""
PARTS = 0.15
"""m/s from where on they part: a bias of 0.1 m/s2 and a pitch of 1.5 deg make 0.09 in ``PULL``."""
LEVER, NOISE = 0.1, 0.1
"""m, one sigma of how far the IMU is before or behind the axle, where 0.1 m feels 0.9 m/s2 of a
turn at 3 rad/s; m/s, one sigma of what else parts both speeds, new every ``PULL``."""
PULL = 0.25
"""s: time constant."""
LOOSE = 0.15
"""m/s, one sigma of the speed over ground while the wheels spin: half a second of a bias of 0.1
m/s2, and 0.1 of when it began."""
LONGEST = 1.0
"""s for which the integral counts; a bias of 0.1 m/s2 makes 0.1 m/s of it."""


class Spin:
    """``moved`` for each step: what the car has gone along its nose, as far as that is known."""

    def __init__(self) -> None:
        self._ground: float | None = None
        self._since = self._swing = self._lever = 0.0
        self._variance = LEVER**2
        self._last: deque[tuple[float, float]] = deque(maxlen=WINDOW)

    def moved(self, along: float, dt: float, accel: float | None, turn: float = 0.0
              ) -> float | None:
        """Speed over ground [m/s] while the wheels are not believed, else None.

        along [m] by the wheels and turn [rad] in dt [s]; accel [m/s2] along the nose, None while
        none is known.
        """
        self._last.append((along, dt))
        way, time = map(sum, zip(*self._last, strict=True))
        wheels = way / max(time, 1e-9)
        if accel is None or self._ground is None or self._since > LONGEST:
            self._ground, self._since = wheels, 0.0
            return None
        felt = (turn / dt)**2 if dt > 0.0 else 0.0
        self._swing += (felt - self._swing / PULL) * dt
        accel += self._lever * felt
        self._ground += accel * dt
        off = wheels - (self._ground - accel * 0.5 * time)
        if abs(off) > PARTS + 2.0 * self._variance**0.5 * self._swing:
            self._since += dt
            return self._ground
        self._since = 0.0
        self._learn(off, dt)
        self._ground += off * min(dt / PULL, 1.0)
        return None

    def _learn(self, off: float, dt: float) -> None:
        """A scalar Kalman filter of the lever: ``off`` [m/s] is what it does, and noise."""
        noise = NOISE**2 * PULL / max(dt, 1e-9)
        gain = self._variance * self._swing / (self._variance * self._swing**2 + noise)
        self._lever += gain * off
        self._variance *= 1.0 - gain * self._swing
