"""Closed paths for the path task: points at equal distances, with heading and curvature."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.errors import UsageError
from dart_hal.sim.light.ops import Ops
from dart_hal.types import FloatArray
from dart_hal.vehicle.namespace import Value

SPACING = 0.02
"""m between points, about."""
SEARCHES = 3
"""Newton steps to the closest point: from 0.3 m off it ends within 0.1 mm."""
MOST = 0.5
"""m that one of them moves at most: a search never jumps to another part of the path."""

Piece = tuple[float, float]
"""(length [m], curvature [1/m], left positive)."""


@dataclass(frozen=True)
class Track:
    """A closed path; arrays (n,) of x, y [m], heading [rad, unwrapped], curvature [1/m]."""

    name: str
    length: float
    x: FloatArray
    y: FloatArray
    heading: FloatArray
    curvature: FloatArray

    @property
    def spacing(self) -> float:
        """Distance between points [m]."""
        return self.length / len(self.x)


def track_of(name: str, pieces: Sequence[Piece]) -> Track:
    """A track of arcs and straights joined without a kink, from the origin along +x.

    Raises UsageError when the end does not meet the start.
    """
    ends = np.cumsum([length for length, _ in pieces])
    n = round(float(ends[-1]) / SPACING)
    s = np.arange(n + 1) * (ends[-1] / n)
    which = np.minimum(np.searchsorted(ends, s, side="right"), len(pieces) - 1)
    x, y, heading = (np.empty(n + 1) for _ in range(3))
    pose, begin = (0.0, 0.0, 0.0), 0.0
    for i, (length, k) in enumerate(pieces):
        on = which == i
        x[on], y[on], heading[on] = _along(pose, s[on] - begin, k)
        end = _along(pose, np.array(length), k)
        pose, begin = (float(end[0]), float(end[1]), float(end[2])), begin + length
    if math.hypot(pose[0], pose[1]) > 1e-6 or abs(math.sin(0.5 * pose[2])) > 1e-6:
        raise UsageError(f"the track {name!r} is not closed",
                         found=f"it ends at {pose[0]:.3f}, {pose[1]:.3f} m, {pose[2]:.3f} rad",
                         expected="0, 0 m and whole turns")
    curvature = np.array([k for _, k in pieces])[which]
    return Track(name, float(ends[-1]), x[:-1], y[:-1], heading[:-1], curvature[:-1])


def _along(pose: tuple[float, float, float], s: FloatArray,
           k: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses at distances s along an arc of curvature k."""
    x, y, yaw = pose
    half = 0.5 * k * s
    chord = s * np.sinc(half / math.pi)
    return x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + k * s


def _arc(radius: float, degrees: float) -> Piece:
    """Part of a circle; positive = left."""
    return abs(math.radians(degrees)) * radius, math.copysign(1.0 / radius, degrees)


def _vicon() -> list[Piece]:
    """The track of the authors' curvature-aware MPC: 4.5 m square, turns of 0.75 m, 22.92 m."""
    left, right, half, square = _arc(0.75, 180), _arc(0.75, -180), _arc(0.75, 90), 2.25
    return [(1.5, 0.0), half, (3.0, 0.0), left, (square, 0.0), right, (square, 0.0), left,
            (3.0, 0.0), half, (1.5, 0.0)]


TRACKS: dict[str, list[Piece]] = {
    "vicon": _vicon(),
    "oval": [(2.4, 0.0), _arc(0.8, 180), (2.4, 0.0), _arc(0.8, 180)],
    "eight": [_arc(1.0, 360), _arc(1.0, -360)],
    "circle": [_arc(1.0, 360)],
}
"""Tracks by name; "oval": two straights of 2.4 m and half circles of 0.8 m."""


def track_named(track: Track | str) -> Track:
    """The track itself, or one of ``TRACKS``. Raises UsageError for an unknown name."""
    if isinstance(track, Track):
        return track
    if track not in TRACKS:
        raise UsageError(f"no track is called {track!r}", expected=", ".join(TRACKS),
                         remedy="docs/how_to/learning.md lists the tracks")
    return track_of(track, TRACKS[track])


Pose = tuple[Value, Value, Value]


def make_point(track: Track, ops: Ops) -> Callable[[Value], tuple[Value, Value, Value, Value]]:
    """``point(s)``: (x, y, heading, curvature) at arc length s [m], of any lap."""
    x, y, heading, curvature = (ops.table(v.tolist()) for v in (
        track.x, track.y, track.heading, track.curvature))
    n, per, h = len(track.x), 1.0 / track.spacing, track.spacing
    cos, sin, whole = ops.f.cos, ops.f.sin, ops.whole

    def point(s: Value) -> tuple[Value, Value, Value, Value]:
        k = whole(s * per + 0.5)
        d, i = s - k * h, k % n
        yaw, bend = heading[i], curvature[i]
        middle = yaw + 0.5 * bend * d
        return x[i] + d * cos(middle), y[i] + d * sin(middle), yaw + bend * d, bend

    return point


def make_locate(track: Track,
                ops: Ops) -> Callable[[Value, Value, Value], tuple[Value, Value, Value]]:
    """``locate(x, y, near) -> (s, offset, heading)`` of the closest point.

    The search starts at arc length ``near`` [m] and stays around it, so a path
    may cross itself, and s grows over laps. offset [m] is positive to the left.
    """
    point, f = make_point(track, ops), ops.f

    def locate(x: Value, y: Value, near: Value) -> tuple[Value, Value, Value]:
        s = near
        for _ in range(SEARCHES):
            px, py, yaw, bend = point(s)
            c, d = f.cos(yaw), f.sin(yaw)
            along, left = (x - px) * c + (y - py) * d, (y - py) * c - (x - px) * d
            s = s + f.fmax(-MOST, f.fmin(MOST, along / f.fmax(0.3, 1.0 - bend * left)))
        px, py, yaw, _ = point(s)
        return s, (y - py) * f.cos(yaw) - (x - px) * f.sin(yaw), yaw

    return locate
