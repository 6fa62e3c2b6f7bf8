"""Closed tracks by name, as arcs and straights."""

from __future__ import annotations

import math

from dart_hal.control.paths import Segment


def _arc(radius: float, degrees: float) -> Segment:
    """Part of a circle; positive = left."""
    return abs(math.radians(degrees)) * radius, math.copysign(1.0 / radius, degrees)


def _vicon() -> list[Segment]:
    """The track of the authors' curvature-aware MPC: 4.5 m square, turns of 0.75 m, 22.92 m."""
    left, right, half, square = _arc(0.75, 180), _arc(0.75, -180), _arc(0.75, 90), 2.25
    return [(1.5, 0.0), half, (3.0, 0.0), left, (square, 0.0), right, (square, 0.0), left,
            (3.0, 0.0), half, (1.5, 0.0)]


TRACKS: dict[str, list[Segment]] = {
    "vicon": _vicon(),
    "oval": [(2.4, 0.0), _arc(0.8, 180), (2.4, 0.0), _arc(0.8, 180)],
    "eight": [_arc(1.0, 360), _arc(1.0, -360)],
    "circle": [_arc(1.0, 360)],
}
"""Tracks by name; "oval": two straights of 2.4 m and half circles of 0.8 m."""
