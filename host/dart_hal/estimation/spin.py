"""Whether wheels spin or lock: their speed beside what the accelerometer says that the car does.

The ground's speed is integrated from the acceleration and pulled to that of the wheels, so that a
bias of the accelerometer stays small. Where both part, the wheels are not believed for as long as
the integral is any good.
"""

from __future__ import annotations

from collections import deque

WINDOW = 4
"""Steps over which speeds are compared: edges of the ring come unevenly."""
PARTS = 0.3
"""m/s from where on they part: tyres that pull at the limit slip by 0.2; an IMU 0.1 m off the axle
feels 0.9 m/s2 of a turn at 3 rad/s, which is 0.2 m/s after ``PULL``."""
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
        self._since = 0.0
        self._last: deque[tuple[float, float]] = deque(maxlen=WINDOW)

    def moved(self, along: float, dt: float, accel: float | None) -> float | None:
        """Speed over ground [m/s] while the wheels are not believed, else None.

        along [m] by the wheels in dt [s]; accel [m/s2] along the nose, None while none is known.
        """
        self._last.append((along, dt))
        way, time = map(sum, zip(*self._last, strict=True))
        wheels = way / max(time, 1e-9)
        if accel is None or self._ground is None or self._since > LONGEST:
            self._ground, self._since = wheels, 0.0
            return None
        self._ground += accel * dt
        middle = self._ground - accel * 0.5 * time
        if abs(wheels - middle) > PARTS:
            self._since += dt
            return self._ground
        self._since = 0.0
        self._ground += (wheels - middle) * min(dt / PULL, 1.0)
        return None
