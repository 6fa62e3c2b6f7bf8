"""Paths over arc length: position, heading, curvature, closest point."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, inf, pi, sin
from typing import Any, NamedTuple

import numpy as np

from dart_hal.compat import RenamedMethod, accept_old_keyword
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# Distance between the stored points [m]: a chord of the tightest turn (0.4 m) is 0.1 mm off.
POINT_SPACING = 0.02
# Length of the path that is searched around the last closest point [m]: never a global jump, so a
# path may cross itself.
SEARCH_AHEAD = 1.0
SEARCH_BEHIND = 0.2
# Largest distance between end and start of a closed path [m], and half the angle [rad]: rounding.
MAX_GAP = 1e-6
# Largest turn [rad] from one step between points to the next. A triangle has 2.1; a path that goes
# back along itself has pi, and its spline hides the cusp.
MAX_TURN = 2.6
# Chords of a spline per ``POINT_SPACING``, by which its length is summed: on 0.4 m it is 4e-6
# short.
CHORDS_PER_SPACING = 5

# (length [m], curvature [1/m], left positive).
Segment = tuple[float, float]


class PathPoint(NamedTuple):
    """A point of a path: x, y [m], heading [rad], curvature [1/m, left positive]."""

    x: float
    y: float
    heading: float
    curvature: float


class Path:
    """A closed or open path, evaluated about every ``POINT_SPACING`` metres.

    x, y [m], heading [rad, unwrapped], curvature [1/m, left positive] at the
    equidistant arc lengths s [m]: shape (n,).
    """

    def __init__(self, segments: Sequence[Segment], *, closed: bool,
                 start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Join arcs and straights without a kink.

        Raises UsageError if a closed path has a gap, and for what is no segment. ``Path.through``
        makes a path of points.
        """
        parts = np.array(segments, dtype=float)
        if (parts.ndim != 2 or parts.shape[1:] != (2,) or not len(parts)
                or not np.isfinite(parts).all() or not (parts[:, 0] > 0.0).all()):
            raise UsageError("a path needs segments", found=repr(segments)[:100],
                             expected="(length [m] above 0, curvature [1/m]) of one or more",
                             remedy="Path.through(points, closed=...) makes a path of points")
        length, k = parts.T
        end = np.cumsum(length)
        n = sum(max(1, round(part / POINT_SPACING)) for part in length)
        x, y, yaw = (np.array([v]) for v in start)
        for part, bend in zip(length, k, strict=True):
            pose = _advance_on_arc(x[-1], y[-1], yaw[-1], part, bend)
            x, y, yaw = (np.append(v, new) for v, new in zip((x, y, yaw), pose, strict=True))
        gap = hypot(x[-1] - x[0], y[-1] - y[0]), abs(sin(0.5 * (yaw[-1] - yaw[0])))
        if closed and max(gap) > MAX_GAP:
            raise UsageError("the path is not closed",
                             found=f"it ends at {x[-1]:.3f}, {y[-1]:.3f} m, {yaw[-1]:.3f} rad",
                             expected="the start, and whole turns")
        s = float(end[-1]) / n * np.arange(n)
        i = np.searchsorted(end[:-1] - MAX_GAP, s, side="right")
        self._set_points(float(end[-1]), closed,
                         *_advance_on_arc(x[i], y[i], yaw[i], s - (end - length)[i], k[i]), k[i])

    def _set_points(
        self,
        length: float,
        closed: bool,
        x: FloatArray,
        y: FloatArray,
        heading: FloatArray,
        curvature: FloatArray,
        speed: FloatArray | None = None,
    ) -> None:
        self.closed = closed
        self.length = length
        self.speed = speed
        """Speed of the path at its points (n,) [m/s], or None."""
        self.spacing = length / len(x)
        """Distance between two points [m]."""
        self.s: FloatArray = self.spacing * np.arange(len(x), dtype=np.float64)
        self.x = x
        self.y = y
        self.heading = heading
        self.curvature = curvature

    @classmethod
    def through(cls, points: Any, *, closed: bool, speed: FloatArray | None = None) -> Path:
        """Fit a cubic spline (C2; natural, or periodic when closed) through points (n, 2) [m].

        A closed one returns to its first point, which is not repeated. speed (n,) [m/s]:
        interpolated linearly between the points. Raises UsageError for fewer than 3 points,
        repeated points and values that are not finite.
        """
        points = check_points(points, closed)
        from scipy.interpolate import CubicSpline

        points = np.vstack([points, points[:1]]) if closed else points
        chord = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
        spline = CubicSpline(chord, points, bc_type="periodic" if closed else "natural")
        u = np.linspace(0.0, chord[-1], CHORDS_PER_SPACING * round(chord[-1] / POINT_SPACING) + 2)
        arc_length = np.append(0.0, np.cumsum(np.hypot(*np.diff(spline(u), axis=0).T)))
        n = max(3, round(arc_length[-1] / POINT_SPACING))
        u = np.interp(arc_length[-1] / n * np.arange(n), arc_length, u)
        (x, y), (dx, dy), (ddx, ddy) = (spline(u, order).T for order in range(3))
        path = cls.__new__(cls)
        path._set_points(float(arc_length[-1]), closed, x, y, np.unwrap(np.arctan2(dy, dx)),
                         (dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3)
        if speed is not None:
            point_speed = np.append(speed, speed[:1])[:len(chord)]
            path.speed = np.asarray(np.interp(u, chord, point_speed), dtype=np.float64)
        return path

    def moved(self, x: float, y: float, yaw: float) -> Path:
        """Return the path, begun at another position [m] and heading [rad]."""
        turn = yaw - float(self.heading[0])
        c = cos(turn)
        s = sin(turn)
        dx = self.x - self.x[0]
        dy = self.y - self.y[0]
        path = type(self).__new__(type(self))
        path._set_points(self.length, self.closed, x + c * dx - s * dy, y + s * dx + c * dy,
                         self.heading + turn, self.curvature, self.speed)
        return path

    def reversed(self) -> Path:
        """Return the path from its end to its start; a closed one keeps its start."""
        back = self.length - self.s
        points = np.array([self.interpolate(float(s)) for s in back]).T
        path = type(self).__new__(type(self))
        speed = self.speed
        if speed is not None:
            known = np.append(speed, speed[0 if self.closed else -1])
            speed = np.interp(back, np.append(self.s, self.length), known)
        path._set_points(self.length, self.closed, points[0], points[1], np.unwrap(points[2] + pi),
                         -points[3], speed)
        return path

    def interpolate(self, s: float) -> PathPoint:
        """Return the point at arc length ``s`` [m] of any lap; an open path continues straight."""
        s_on_path = s if self.closed else min(max(s, 0.0), self.length)
        k = round(s_on_path / self.spacing)
        k = k if self.closed else min(k, len(self.x) - 1)
        d = s_on_path - k * self.spacing
        i = k % len(self.x)
        yaw = float(self.heading[i])
        bend = float(self.curvature[i])
        mean_heading = yaw + 0.5 * bend * d
        end_heading = yaw + bend * d
        overshoot = s - s_on_path
        return PathPoint(
            float(self.x[i]) + d * cos(mean_heading) + overshoot * cos(end_heading),
            float(self.y[i]) + d * sin(mean_heading) + overshoot * sin(end_heading),
            end_heading,
            0.0 if overshoot else bend,
        )

    at = RenamedMethod("interpolate")

    def nearest(self, x: float, y: float) -> float:
        """Return the arc length [m] of the stored point that is nearest to x, y [m].

        >>> figure_of_eight(0.75).nearest(0.0, 0.0)
        0.0
        """
        return float(self.s[np.argmin(np.hypot(self.x - x, self.y - y))])

    @accept_old_keyword("near", "s_guess")
    def closest(self, x: float, y: float, s_guess: float) -> float:
        """Return the arc length of the closest point, searched around ``s_guess`` [m]."""
        low = int((s_guess - SEARCH_BEHIND) / self.spacing)
        index = np.arange(low, low + int((SEARCH_AHEAD + SEARCH_BEHIND) / self.spacing))
        index = index % len(self.x) if self.closed else np.clip(index, 0, len(self.x) - 1)
        nearest = int(np.argmin((self.x[index] - x) ** 2 + (self.y[index] - y) ** 2))
        s = float(self.s[index[nearest]])
        laps = round((s_guess - s) / self.length) if self.closed else 0
        return self._refine_closest(x, y, s) + laps * self.length

    def _refine_closest(self, x: float, y: float, s: float) -> float:
        """Do one Newton step from the closest stored point."""
        point = self.interpolate(s)
        c = cos(point.heading)
        d = sin(point.heading)
        along = (x - point.x) * c + (y - point.y) * d
        left = (y - point.y) * c - (x - point.x) * d
        step = along / max(0.3, 1.0 - point.curvature * left)
        s += min(max(step, -self.spacing), self.spacing)
        return s if self.closed else min(max(s, 0.0), self.length)

    def point(self, s: float) -> tuple[float, float]:
        """Return the position [m] at arc length ``s``; an open path ends at its last point."""
        return self.interpolate(s if self.closed else min(max(s, 0.0), self.length))[:2]

    def offset(self, x: float, y: float, s: float) -> float:
        """Return the distance to the left of the path at ``s`` [m]; beyond its end of the straight.
        """
        point = self.interpolate(s)
        return cos(point.heading) * (y - point.y) - sin(point.heading) * (x - point.x)

    def curvatures(self, s: FloatArray) -> FloatArray:
        """Return the curvature [1/m] at many arc lengths [m]; 0 beyond the ends of an open path."""
        k = np.rint(s / self.spacing).astype(int)
        inside = self.closed | ((s >= 0.0) & (s <= self.length))
        k = k % len(self.x) if self.closed else np.clip(k, 0, len(self.x) - 1)
        curvature: FloatArray = self.curvature[k] * inside
        return curvature


def check_points(points: Any, closed: bool) -> FloatArray:
    """Return points (n, 2) that can be joined. Raises UsageError as ``Path.through``."""
    xy = np.asarray(points, dtype=float)
    if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 3:
        raise UsageError("a path needs three points", found=f"points of shape {xy.shape}",
                         expected="x, y [m] of at least 3 points")
    if not np.isfinite(xy).all():
        k = int(np.flatnonzero(~np.isfinite(xy).all(axis=1))[0])
        raise UsageError(f"point {k + 1} of the path is not finite", found=str(tuple(xy[k])),
                         expected="x and y in m")
    gaps = np.hypot(*np.diff(np.vstack([xy, xy[:1]]) if closed else xy, axis=0).T)
    if (gaps < MAX_GAP).any():
        k = int(np.argmax(gaps < MAX_GAP))
        closes = closed and k == len(xy) - 1
        raise UsageError(f"points {k + 1} and {(k + 1) % len(xy) + 1} of the path are the same",
                         found=f"{xy[k, 0]:g}, {xy[k, 1]:g} m twice",
                         expected="points that go on",
                         remedy="leave the last point out: a closed path goes on to the first"
                                if closes else "remove one; only the last may repeat the first, "
                                "which closes the path of a file")
    steps = np.diff(np.vstack([xy, xy[:2]]) if closed else xy, axis=0)
    turns = np.arctan2(steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0],
                       np.sum(steps[:-1] * steps[1:], axis=1))
    if (np.abs(turns) > MAX_TURN).any():
        k = int(np.argmax(np.abs(turns) > MAX_TURN)) + 1
        raise UsageError(f"the path turns back at point {k % len(xy) + 1}",
                         found=f"a turn of {np.degrees(abs(turns[k - 1])):.0f} deg between "
                               "neighbouring points",
                         expected=f"at most {np.degrees(MAX_TURN):.0f} deg",
                         remedy="lay the turn out as an arc that the car can drive")
    return xy


def _advance_on_arc(x: Any, y: Any, yaw: Any, s: Any, k: Any) -> tuple[Any, Any, Any]:
    """Return poses at a distance s [m] from poses, on arcs of curvature k [1/m]."""
    half = 0.5 * k * s
    chord = s * np.sinc(half / pi)
    return x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + k * s


def figure_of_eight(radius: float) -> Path:
    """Return a left circle and a right circle of ``radius`` [m] that meet at the start.

    Raises UsageError for a radius that is not above 0.
    """
    if not 0.0 < radius < inf:
        raise UsageError("a circle needs a radius", found=f"{radius!r} m", expected="above 0 m")
    return Path([(2 * pi * radius, 1 / radius), (2 * pi * radius, -1 / radius)], closed=True)
