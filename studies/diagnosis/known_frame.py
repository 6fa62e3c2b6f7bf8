"""Reading of hidden drives: the marker frame is given, as by a user who has measured it.

The cars that are simulated wear their markers where DART did on the day of the recording. A fitted
frame has errors of its own, which ``tests/recorded/test_marker_frames.py`` is about.
"""

from __future__ import annotations

from pathlib import Path

from dart_hal.recording.dart import Recording, Reference, with_marker_frames
from dart_hal.recording.dart import read as read_file
from studies.diagnosis.stranger_files import PLACES

DAY = 86_400.0
"""s."""


def read(path: str | Path) -> Recording:
    """The recording with the marker frame that the simulated car has on its day; one of another
    day is no simulated one."""
    recording = read_file(path)
    if recording.mocap is None or recording.mocap.epoch is None:
        return recording
    frames = {frame for epoch, frame in PLACES.values()
              if abs(recording.mocap.epoch - epoch) < DAY}
    given = Reference(*frames.pop(), "of the simulation") if frames else None
    return with_marker_frames([recording], given)[0]
