"""Paths over arc length: position, heading, curvature, closest point."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, pi, sin
from typing import Any, NamedTuple

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# m between the stored points: a chord of the tightest turn (0.4 m) is 0.1 mm off.
STEP = 0.02
# m of the path that are searched around the last closest point: never a global jump, so a path
# may cross itself.
AHEAD = 1.0
BEHIND = 0.2
# m between end and start of a closed path (and half the angle in rad): rounding.
GAP = 1e-6
# Chords of a spline to a ``STEP``, by which its length is summed: on 0.4 m it is 4e-6 short.
FINE = 5

# (length [m], curvature [1/m], left positive).
Segment = tuple[float, float]


class Spot(NamedTuple):
    """A place on a path: x, y [m], heading [rad], curvature [1/m, left positive]."""

    x: float
    y: float
    heading: float
    curvature: float


class Path:
    """A closed or open path, evaluated about every ``STEP`` metres.

    x, y [m], heading [rad, unwrapped], curvature [1/m, left positive] at the
    equidistant arc lengths s [m]: shape (n,).
    """

    def __init__(self, segments: Sequence[Segment], *, closed: bool,
                 start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Arcs and straights, joined without a kink. Raises UsageError if a closed path has a gap.

        ``Path.through`` makes one of points.
        """
        length, k = np.array(segments, dtype=float).T
        end = np.cumsum(length)
        n = sum(max(1, round(part / STEP)) for part in length)
        x, y, yaw = (np.array([v]) for v in start)
        for part, bend in zip(length, k, strict=True):
            pose = _along(x[-1], y[-1], yaw[-1], part, bend)
            x, y, yaw = (np.append(v, new) for v, new in zip((x, y, yaw), pose, strict=True))
        gap = hypot(x[-1] - x[0], y[-1] - y[0]), abs(sin(0.5 * (yaw[-1] - yaw[0])))
        if closed and max(gap) > GAP:
            raise UsageError("the path is not closed",
                             found=f"it ends at {x[-1]:.3f}, {y[-1]:.3f} m, {yaw[-1]:.3f} rad",
                             expected="the start, and whole turns")
        s = float(end[-1]) / n * np.arange(n)
        i = np.searchsorted(end[:-1] - GAP, s, side="right")
        self._keep(float(end[-1]), closed,
                   *_along(x[i], y[i], yaw[i], s - (end - length)[i], k[i]), k[i])

    def _keep(self, length: float, closed: bool, x: FloatArray, y: FloatArray,
              heading: FloatArray, curvature: FloatArray, speed: FloatArray | None = None) -> None:
        self.closed = closed
        self.length = length
        self.speed = speed
        """m/s that the path asks for at its points, (n,); None: it does not."""
        self.spacing = length / len(x)
        """Distance between two points [m]."""
        self.s: FloatArray = self.spacing * np.arange(len(x), dtype=np.float64)
        self.x = x
        self.y = y
        self.heading = heading
        self.curvature = curvature

    @classmethod
    def through(cls, points: Any, *, closed: bool, speed: FloatArray | None = None) -> Path:
        """A cubic spline (C2; natural, or periodic when closed) through points (n, 2) [m].

        A closed one goes back to its first point, which is not repeated. speed (n,) [m/s]: straight
        between the points. Raises UsageError for fewer than 3 points, repeated ones
        and what is not finite.
        """
        at = checked_points(points, closed)
        from scipy.interpolate import CubicSpline

        at = np.vstack([at, at[:1]]) if closed else at
        chord = np.append(0.0, np.cumsum(np.hypot(*np.diff(at, axis=0).T)))
        spline = CubicSpline(chord, at, bc_type="periodic" if closed else "natural")
        u = np.linspace(0.0, chord[-1], FINE * round(chord[-1] / STEP) + 2)
        way = np.append(0.0, np.cumsum(np.hypot(*np.diff(spline(u), axis=0).T)))
        n = max(3, round(way[-1] / STEP))
        u = np.interp(way[-1] / n * np.arange(n), way, u)
        (x, y), (dx, dy), (ddx, ddy) = (spline(u, order).T for order in range(3))
        path = cls.__new__(cls)
        path._keep(float(way[-1]), closed, x, y, np.unwrap(np.arctan2(dy, dx)),
                   (dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3)
        if speed is not None:
            asked = np.append(speed, speed[:1])[:len(chord)]
            path.speed = np.asarray(np.interp(u, chord, asked), dtype=np.float64)
        return path

    def moved(self, x: float, y: float, yaw: float) -> Path:
        """The same path, begun at another place [m] and heading [rad]."""
        turn = yaw - float(self.heading[0])
        c = cos(turn)
        s = sin(turn)
        dx = self.x - self.x[0]
        dy = self.y - self.y[0]
        path = type(self).__new__(type(self))
        path._keep(self.length, self.closed, x + c * dx - s * dy, y + s * dx + c * dy,
                   self.heading + turn, self.curvature, self.speed)
        return path

    def reversed(self) -> Path:
        """The same way from its end to its start, a closed one from where it begins."""
        back = self.length - self.s
        spots = np.array([self.at(float(s)) for s in back]).T
        path = type(self).__new__(type(self))
        speed = self.speed
        if speed is not None:
            known = np.append(speed, speed[0 if self.closed else -1])
            speed = np.interp(back, np.append(self.s, self.length), known)
        path._keep(self.length, self.closed, spots[0], spots[1], np.unwrap(spots[2] + pi),
                   -spots[3], speed)
        return path

    def at(self, s: float) -> Spot:
        """The place at arc length ``s`` [m], of any lap; an open path goes on straight."""
        inside = s if self.closed else min(max(s, 0.0), self.length)
        k = round(inside / self.spacing)
        k = k if self.closed else min(k, len(self.x) - 1)
        d = inside - k * self.spacing
        i = k % len(self.x)
        yaw = float(self.heading[i])
        bend = float(self.curvature[i])
        middle = yaw + 0.5 * bend * d
        end = yaw + bend * d
        beyond = s - inside
        return Spot(float(self.x[i]) + d * cos(middle) + beyond * cos(end),
                    float(self.y[i]) + d * sin(middle) + beyond * sin(end), end,
                    0.0 if beyond else bend)

    def closest(self, x: float, y: float, near: float) -> float:
        """Arc length of the closest point, searched around ``near`` [m]."""
        low = int((near - BEHIND) / self.spacing)
        index = np.arange(low, low + int((AHEAD + BEHIND) / self.spacing))
        index = index % len(self.x) if self.closed else np.clip(index, 0, len(self.x) - 1)
        nearest = int(np.argmin((self.x[index] - x) ** 2 + (self.y[index] - y) ** 2))
        found = float(self.s[index[nearest]])
        laps = round((near - found) / self.length) if self.closed else 0
        return self._refined(x, y, found) + laps * self.length

    def _refined(self, x: float, y: float, s: float) -> float:
        """One step of Newton from the closest stored point."""
        spot = self.at(s)
        c = cos(spot.heading)
        d = sin(spot.heading)
        along = (x - spot.x) * c + (y - spot.y) * d
        left = (y - spot.y) * c - (x - spot.x) * d
        step = along / max(0.3, 1.0 - spot.curvature * left)
        s += min(max(step, -self.spacing), self.spacing)
        return s if self.closed else min(max(s, 0.0), self.length)

    def point(self, s: float) -> tuple[float, float]:
        """Position [m] at arc length ``s``; an open path ends at its last point."""
        return self.at(s if self.closed else min(max(s, 0.0), self.length))[:2]

    def offset(self, x: float, y: float, s: float) -> float:
        """Distance to the left of the path at ``s`` [m]; behind its end, of where it goes on."""
        spot = self.at(s)
        return cos(spot.heading) * (y - spot.y) - sin(spot.heading) * (x - spot.x)

    def curvatures(self, s: FloatArray) -> FloatArray:
        """Curvature [1/m] at many arc lengths [m]; 0 beyond the ends of an open path."""
        k = np.rint(s / self.spacing).astype(int)
        inside = self.closed | ((s >= 0.0) & (s <= self.length))
        k = k % len(self.x) if self.closed else np.clip(k, 0, len(self.x) - 1)
        bends: FloatArray = self.curvature[k] * inside
        return bends


def checked_points(points: Any, closed: bool) -> FloatArray:
    """Points (n, 2) as they may be joined. Raises UsageError as ``Path.through``."""
    at = np.asarray(points, dtype=float)
    if at.ndim != 2 or at.shape[1] != 2 or len(at) < 3:
        raise UsageError("a path needs three points", found=f"points of shape {at.shape}",
                         expected="x, y [m] of at least 3 points")
    if not np.isfinite(at).all():
        k = int(np.flatnonzero(~np.isfinite(at).all(axis=1))[0])
        raise UsageError(f"point {k + 1} of the path is not finite", found=str(tuple(at[k])),
                         expected="x and y in m")
    gaps = np.hypot(*np.diff(np.vstack([at, at[:1]]) if closed else at, axis=0).T)
    if (gaps < GAP).any():
        k = int(np.argmax(gaps < GAP))
        raise UsageError(f"points {k + 1} and {(k + 1) % len(at) + 1} of the path are the same",
                         found=f"{at[k, 0]:g}, {at[k, 1]:g} m twice",
                         expected="points that go on",
                         remedy="leave one out; only the last may repeat the first, which closes "
                                "the path of a file")
    return at


def _along(x: Any, y: Any, yaw: Any, s: Any, k: Any) -> tuple[Any, Any, Any]:
    """Poses at distance s [m] from poses, on arcs of curvature k [1/m]."""
    half = 0.5 * k * s
    chord = s * np.sinc(half / pi)
    return x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + k * s


def figure_of_eight(radius: float) -> Path:
    """A left circle and a right circle of ``radius`` [m] that meet at the start."""
    return Path([(2 * pi * radius, 1 / radius), (2 * pi * radius, -1 / radius)], closed=True)
