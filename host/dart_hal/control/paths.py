"""Paths over arc length: position, heading, curvature, closest point."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

import numpy as np

from dart_hal.types import FloatArray

STEP = 0.02
"""m between the stored points: a chord of the tightest turn (0.4 m) is 0.1 mm off."""
AHEAD, BEHIND = 1.0, 0.2
"""m of the path that are searched around the last closest point: never a global
jump, so a path may cross itself."""


class Path:
    """A closed or open path, evaluated every ``STEP`` metres.

    x, y [m], heading [rad, unwrapped], curvature [1/m, left positive]: shape (n,).
    """

    def __init__(self, segments: Sequence[tuple[float, float]], *, closed: bool,
                 start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """``segments``: (length [m], curvature [1/m]) pieces joined without a kink."""
        counts = [max(1, round(length / STEP)) for length, _ in segments]
        ds = np.repeat([length / n for (length, _), n in zip(segments, counts, strict=True)],
                       counts)
        self.closed = closed
        self.curvature: FloatArray = np.repeat([k for _, k in segments], counts)
        x0, y0, yaw0 = start
        turn = ds * self.curvature
        heading = yaw0 + np.concatenate([[0.0], np.cumsum(turn)])
        middle = heading[:-1] + turn / 2
        chord = ds * np.sinc(turn / 2 / pi)
        self.heading: FloatArray = heading[:-1]
        self.x: FloatArray = x0 + np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])[:-1]
        self.y: FloatArray = y0 + np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])[:-1]
        self.s: FloatArray = np.concatenate([[0.0], np.cumsum(ds)])[:-1]
        self.length = float(ds.sum())

    @property
    def min_radius(self) -> float:
        """Tightest turn [m]; inf on a straight."""
        k = float(np.abs(self.curvature).max())
        return 1.0 / k if k else float("inf")

    def closest(self, x: float, y: float, near: float) -> float:
        """Arc length of the closest point, searched around ``near`` [m]."""
        low = int((near - BEHIND) / self.length * len(self.x))
        index = np.arange(low, low + int((AHEAD + BEHIND) / STEP))
        index = index % len(self.x) if self.closed else np.clip(index, 0, len(self.x) - 1)
        nearest = int(np.argmin((self.x[index] - x) ** 2 + (self.y[index] - y) ** 2))
        found = float(self.s[index[nearest]])
        laps = round((near - found) / self.length) if self.closed else 0
        return found + laps * self.length

    def point(self, s: float) -> tuple[float, float]:
        """Position [m] at arc length ``s``; an open path ends at its last point."""
        i = int(s / self.length * len(self.x))
        i = i % len(self.x) if self.closed else min(max(i, 0), len(self.x) - 1)
        return float(self.x[i]), float(self.y[i])

    def offset(self, x: float, y: float, s: float) -> float:
        """Distance to the left of the path at ``s`` [m]."""
        i = int(s / self.length * len(self.x)) % len(self.x)
        dx, dy = x - self.x[i], y - self.y[i]
        return float(-sin(self.heading[i]) * dx + cos(self.heading[i]) * dy)


def figure_of_eight(radius: float) -> Path:
    """A left circle and a right circle of ``radius`` [m] that meet at the start."""
    return Path([(2 * pi * radius, 1 / radius), (2 * pi * radius, -1 / radius)], closed=True)

