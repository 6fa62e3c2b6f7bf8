"""Which way the wheels turn, felt: the car's acceleration against the change of their speed.

One encoder has no sign, its speed is |v|. While |v| grows, forwards, the accelerometer feels it
grow; backwards it feels the opposite. Over a window

    d|v| = s * integral of a_x        s: +1 forwards, -1 backwards

holds with one of the two signs, or with none: the wheels slip, the car turned round within the
window, or nothing changes enough to tell.
"""

from __future__ import annotations

from collections import deque

WINDOW = 0.4
"""s: long against the lags of the two (15 ms of a pair of edges, 5 ms of the accelerometer)."""
CHANGE = 0.25
"""m/s of |v| in a window that tell: twice what the accelerometer is wrong by in it, 0.3 m/s2 of
tilt that the fusion has not found. A car that gains less than 0.6 m/s2 says nothing."""
FITS = 0.4
"""Share of the change by which what is felt may miss it; the other sign misses by 2."""
LASTS = 5
"""Frames that say the same: a bump of the floor is over by then."""


class FeltDirection:
    """Give ``add`` each frame: 1 forwards, -1 backwards, 0 where it cannot be told."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what was felt: without samples, after a gap."""
        self._frames: deque[tuple[float, float, float]] = deque()
        self._t = self._felt = 0.0
        self._said = self._times = 0

    def add(self, dt: float, speed: float, acc: float | None) -> int:
        """The last ``dt`` s: ``speed`` [m/s] of the wheels, its sign does not matter; acc [m/s2]
        of the car along x, None = none."""
        if acc is None or not 0.0 <= dt < WINDOW:
            self.restart()
            return 0
        self._t += dt
        self._felt += acc * dt
        frames = self._frames
        frames.append((self._t, abs(speed), self._felt))
        while frames[0][0] < self._t - WINDOW:
            frames.popleft()
        return self._lasting(self._sign(abs(speed)))

    def _sign(self, speed: float) -> int:
        _, before, felt = self._frames[0]
        change, felt = speed - before, self._felt - felt
        if abs(change) < CHANGE:
            return 0
        if abs(felt - change) < FITS * abs(change):
            return 1
        return -1 if abs(felt + change) < FITS * abs(change) else 0

    def _lasting(self, sign: int) -> int:
        self._times = self._times + 1 if sign == self._said else 1
        self._said = sign
        return sign if self._times >= LASTS else 0
