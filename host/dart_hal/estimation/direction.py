"""Direction of travel from inertia: the acceleration compared with the change of the wheel speed.

One encoder has no sign, its speed is |v|. In forward travel the accelerometer measures the growth
of |v|, in reverse the opposite. Over a window

    d|v| = s * integral of a_x        s: +1 forwards, -1 backwards

holds with one of the two signs, or with none: the wheels slip, the car reversed within the window,
or the speed changes too little to decide.
"""

from __future__ import annotations

from collections import deque

# s: long against the lags of both sensors (15 ms of a pair of edges, 5 ms of the accelerometer).
DIRECTION_WINDOW = 0.4
# m/s of |v| within a window that allow a decision: twice the error of the accelerometer, 0.3 m/s2
# of tilt that the fusion has not found. A car that accelerates by less than 0.6 m/s2 gives none.
MIN_SPEED_CHANGE = 0.25
# Largest difference of integral and change, as a share of the change; the wrong sign differs by 2.
MAX_MISFIT = 0.4
# Consecutive frames with the same sign: a bump of the floor is over by then.
MIN_EQUAL_FRAMES = 5


class InertialDirection:
    """Estimates the direction; ``add`` returns 1 forwards, -1 backwards, 0 if undecided."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget the window: after a gap, or without samples."""
        self._frames: deque[tuple[float, float, float]] = deque()
        self._t = self._integral = 0.0
        self._last_sign = self._equal_frames = 0

    def add(self, dt: float, speed: float, acc: float | None) -> int:
        """Add the last ``dt`` s and return the direction.

        speed [m/s]: of the wheels, its sign does not matter; acc [m/s2]: of the car along x,
        None = not valid.
        """
        if acc is None or not 0.0 <= dt < DIRECTION_WINDOW:
            self.restart()
            return 0
        self._t += dt
        self._integral += acc * dt
        frames = self._frames
        frames.append((self._t, abs(speed), self._integral))
        while frames[0][0] < self._t - DIRECTION_WINDOW:
            frames.popleft()
        return self._filter_sign(self._compare_sign(abs(speed)))

    def _compare_sign(self, speed: float) -> int:
        """Return the sign that fits the window, 0 for none."""
        _, before, integral = self._frames[0]
        change = speed - before
        integral = self._integral - integral
        if abs(change) < MIN_SPEED_CHANGE:
            return 0
        if abs(integral - change) < MAX_MISFIT * abs(change):
            return 1
        return -1 if abs(integral + change) < MAX_MISFIT * abs(change) else 0

    def _filter_sign(self, sign: int) -> int:
        """Return the sign once it was the same for MIN_EQUAL_FRAMES frames, else 0."""
        self._equal_frames = self._equal_frames + 1 if sign == self._last_sign else 1
        self._last_sign = sign
        return sign if self._equal_frames >= MIN_EQUAL_FRAMES else 0
