"""The curve as a path: arc length and parameter, from a position and back."""

from __future__ import annotations

from math import pi

import numpy as np

from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.paths import Path, PathPoint

# Size of the table from X to arc length; linear interpolation is 1e-6 m off.
TABLE_SIZE = 20_000
# Cost of the opposite direction in the search of a position [m2]: it distinguishes branches that
# cross by 0.1 rad of heading for 5 cm of position.
HEADING_WEIGHT = 1.0


class Course:
    """``path`` is followed in arc length s [m]; X [rad] is the parameter. Both grow over laps."""

    def __init__(self, curve: Lissajous) -> None:
        self.curve = curve
        self.path = curve.path()
        self._X = np.linspace(0.0, 2.0 * pi, TABLE_SIZE + 1)
        rate = curve.rate(self._X)
        self._s = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]))) * (2.0 * pi / TABLE_SIZE)
        self._s *= self.path.length / self._s[-1]

    def parameter(self, s: float) -> float:
        """Return X [rad] at an arc length [m]."""
        lap, rest = divmod(s, self.path.length)
        return 2.0 * pi * lap + float(np.interp(rest, self._s, self._X))

    def arc_length(self, X: float) -> float:
        """Return the arc length [m] at a parameter [rad]."""
        lap, rest = divmod(X, 2.0 * pi)
        return self.path.length * lap + float(np.interp(rest, self._X, self._s))

    def point_at(self, X: float) -> PathPoint:
        """Return position, heading and curvature at a parameter [rad]."""
        return self.path.interpolate(self.arc_length(X))

    def find(self, x: float, y: float, yaw: float) -> float:
        """Return X [rad], 0 to 2 pi, of a car at x, y [m] with heading yaw [rad].

        Searches the whole curve; where it crosses itself, the heading selects the branch.
        """
        path: Path = self.path
        heading_error = 0.5 * (1.0 - np.cos(path.heading - yaw))
        k = int(np.argmin((path.x - x) ** 2 + (path.y - y) ** 2 + HEADING_WEIGHT * heading_error))
        return self.parameter(path.closest(x, y, float(path.s[k])) % path.length)
