"""Tracks by name, including those of the authors of DART, and paths from files.

``racetrack_vicon_2`` and ``savoiardo`` are those of their curvature-aware MPC. Of
``racetrack_vicon`` the size, radii and length are known: seven lanes up and down reproduce them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path as File

from dart_hal.control.path_file import read_path
from dart_hal.control.paths import Path, Segment, figure_of_eight
from dart_hal.core.errors import UsageError


def _arc(radius: float, degrees: float) -> Segment:
    """Return a part of a circle; positive = left."""
    return abs(math.radians(degrees)) * radius, math.copysign(1.0 / radius, degrees)


def _vicon_2() -> Path:
    """Return a 4.5 m square, turns of 0.75 m, 22.92 m; begins in the middle of the lower side."""
    left = _arc(0.75, 180)
    right = _arc(0.75, -180)
    half = _arc(0.75, 90)
    lane = 2.25
    return Path([(1.5, 0.0), half, (3.0, 0.0), left, (lane, 0.0), right, (lane, 0.0), left,
                 (3.0, 0.0), half, (1.5, 0.0)], closed=True, start=(2.25, 0.0, 0.0))


def _vicon() -> Path:
    """Return a track of 7 x 5.5 m, radii 0.5 and 1.0 m, 41.1 m.

    Without the six inner lanes it has 5 + pi + 8 + 3.5 pi m; they share the rest.
    """
    left = _arc(0.5, 180)
    right = _arc(0.5, -180)
    corner = _arc(1.0, 90)
    lane = ((41.1 - 13.0 - 4.5 * math.pi) / 6.0, 0.0)
    return Path([(2.5, 0.0), corner, (4.0, 0.0), *[left, lane, right, lane] * 3, left,
                 (4.0, 0.0), corner, (2.5, 0.0)], closed=True, start=(3.5, 0.0, 0.0))


def _savoiardo() -> Path:
    """Return two straights of 2.4 m and half circles of 0.8 m."""
    return Path([(2.4, 0.0), _arc(0.8, 180)] * 2, closed=True)


# Tracks by name; "vicon" and "oval" are short names of the first and the third.
TRACKS: dict[str, Callable[[], Path]] = {
    "racetrack_vicon_2": _vicon_2, "racetrack_vicon": _vicon, "savoiardo": _savoiardo,
    "eight": lambda: figure_of_eight(1.0),
    "circle": lambda: Path([_arc(1.0, 360)], closed=True),
    "vicon": _vicon_2, "oval": _savoiardo,
}


def track_named(track: Path | str) -> Path:
    """Return the path itself, a track of ``TRACKS`` by its name, or the path of a file.

    Raises UsageError for an unknown name and as ``read_path``, FileNotFoundError.
    """
    if isinstance(track, Path):
        return track
    if track not in TRACKS and (track.lower().endswith(".csv") or File(track).is_file()):
        return read_path(File(track))
    if track not in TRACKS:
        near = get_close_matches(track, TRACKS, n=1)
        raise UsageError(f"no track is called {track!r}", expected=", ".join(TRACKS),
                         remedy=(f"{near[0]}; " if near else "")
                         + "docs/how_to/following.md lists the tracks")
    return TRACKS[track]()

