"""Reading of hidden drives: the simulated cars wear their markers where DART did in September 2024.

The frame is given, as by a user who has measured it. A fitted one has errors of its own, which
``tests/recorded/test_marker_frames.py`` is about.
"""

from __future__ import annotations

from pathlib import Path

from dart_hal.recording.dart import Recording, Reference, with_marker_frames
from dart_hal.recording.dart import read as read_file

FRAME = Reference(0.115, 0.010, -0.010, "of the simulation")


def read(path: str | Path) -> Recording:
    """The recording with the marker frame of the simulation."""
    return with_marker_frames([read_file(path)], FRAME)[0]
