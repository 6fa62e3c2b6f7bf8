"""Paths over arc length: position, heading, curvature, closest point."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, pi, sin
from typing import Any

import numpy as np

from dart_hal.errors import UsageError
from dart_hal.types import FloatArray

STEP = 0.02
"""m between the stored points: a chord of the tightest turn (0.4 m) is 0.1 mm off."""
AHEAD, BEHIND = 1.0, 0.2
"""m of the path that are searched around the last closest point: never a global
jump, so a path may cross itself."""
GAP = 1e-6
"""m between end and start of a closed path (and half the angle in rad): rounding."""

Segment = tuple[float, float]
"""(length [m], curvature [1/m], left positive)."""


class Path:
    """A closed or open path of arcs and straights, evaluated about every ``STEP`` metres.

    x, y [m], heading [rad, unwrapped], curvature [1/m, left positive] at the
    equidistant arc lengths s [m]: shape (n,).
    """

    def __init__(self, segments: Sequence[Segment], *, closed: bool,
                 start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Segments are joined without a kink. Raises UsageError if a closed path has a gap."""
        length, k = np.array(segments, dtype=float).T
        end = np.cumsum(length)
        n = sum(max(1, round(part / STEP)) for part in length)
        self.closed, self.length = closed, float(end[-1])
        self.spacing = self.length / n
        """Distance between two points [m]."""
        x, y, yaw = (np.array([v]) for v in start)
        for part, bend in zip(length, k, strict=True):
            pose = _along(x[-1], y[-1], yaw[-1], part, bend)
            x, y, yaw = (np.append(v, new) for v, new in zip((x, y, yaw), pose, strict=True))
        gap = hypot(x[-1] - x[0], y[-1] - y[0]), abs(sin(0.5 * (yaw[-1] - yaw[0])))
        if closed and max(gap) > GAP:
            raise UsageError("the path is not closed",
                             found=f"it ends at {x[-1]:.3f}, {y[-1]:.3f} m, {yaw[-1]:.3f} rad",
                             expected="the start, and whole turns")
        self.s: FloatArray = self.spacing * np.arange(n)
        i = np.searchsorted(end[:-1] - GAP, self.s, side="right")
        self.curvature: FloatArray = k[i]
        self.x, self.y, self.heading = _along(x[i], y[i], yaw[i], self.s - (end - length)[i], k[i])

    def closest(self, x: float, y: float, near: float) -> float:
        """Arc length of the closest point, searched around ``near`` [m]."""
        low = int((near - BEHIND) / self.spacing)
        index = np.arange(low, low + int((AHEAD + BEHIND) / self.spacing))
        index = index % len(self.x) if self.closed else np.clip(index, 0, len(self.x) - 1)
        nearest = int(np.argmin((self.x[index] - x) ** 2 + (self.y[index] - y) ** 2))
        found = float(self.s[index[nearest]])
        laps = round((near - found) / self.length) if self.closed else 0
        return found + laps * self.length

    def point(self, s: float) -> tuple[float, float]:
        """Position [m] at arc length ``s``; an open path ends at its last point."""
        i = self._index(s)
        return float(self.x[i]), float(self.y[i])

    def offset(self, x: float, y: float, s: float) -> float:
        """Distance to the left of the path at ``s`` [m]; behind its end, of its last point."""
        i = self._index(s)
        dx, dy = x - self.x[i], y - self.y[i]
        return float(-sin(self.heading[i]) * dx + cos(self.heading[i]) * dy)

    def _index(self, s: float) -> int:
        """The point at ``s`` or the last one before it."""
        i = int(s / self.spacing)
        return i % len(self.x) if self.closed else min(max(i, 0), len(self.x) - 1)


def _along(x: Any, y: Any, yaw: Any, s: Any, k: Any) -> tuple[Any, Any, Any]:
    """Poses at distance s [m] from poses, on arcs of curvature k [1/m]."""
    half = 0.5 * k * s
    chord = s * np.sinc(half / pi)
    return x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + k * s


def figure_of_eight(radius: float) -> Path:
    """A left circle and a right circle of ``radius`` [m] that meet at the start."""
    return Path([(2 * pi * radius, 1 / radius), (2 * pi * radius, -1 / radius)], closed=True)

