"""The curve as a path: arc length and parameter, from a place and back."""

from __future__ import annotations

from math import pi

import numpy as np

from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.paths import Path, Spot

# Values of X in the table from X to arc length; between them it is a line, 1e-6 m off.
FINE = 20_000
# m2 that the opposite direction counts for, where a place is looked for: the branches that cross
# there are told apart by 0.1 rad of heading for 5 cm of place.
AGAINST = 1.0


class Course:
    """``path`` is followed in arc length s [m]; X [rad] is the curve's parameter. Both grow over
    laps."""

    def __init__(self, curve: Lissajous) -> None:
        self.curve = curve
        self.path = curve.path()
        self._X = np.linspace(0.0, 2.0 * pi, FINE + 1)
        way = curve.rate(self._X)
        self._s = np.append(0.0, np.cumsum(0.5 * (way[1:] + way[:-1]))) * (2.0 * pi / FINE)
        self._s *= self.path.length / self._s[-1]

    def parameter(self, s: float) -> float:
        """X [rad] at an arc length [m]."""
        lap, rest = divmod(s, self.path.length)
        return 2.0 * pi * lap + float(np.interp(rest, self._s, self._X))

    def arc(self, X: float) -> float:
        """Arc length [m] at a parameter [rad]."""
        lap, rest = divmod(X, 2.0 * pi)
        return self.path.length * lap + float(np.interp(rest, self._X, self._s))

    def spot(self, X: float) -> Spot:
        """Place, heading and curvature at a parameter [rad]."""
        return self.path.at(self.arc(X))

    def find(self, x: float, y: float, yaw: float) -> float:
        """X [rad], 0 to 2 pi, of who is at x, y [m] and looks along yaw [rad], searched on the
        whole curve; where it crosses itself the heading tells the branch."""
        path: Path = self.path
        turned = 0.5 * (1.0 - np.cos(path.heading - yaw))
        k = int(np.argmin((path.x - x) ** 2 + (path.y - y) ** 2 + AGAINST * turned))
        return self.parameter(path.closest(x, y, float(path.s[k])) % path.length)
