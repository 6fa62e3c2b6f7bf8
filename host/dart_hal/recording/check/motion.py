"""Motion of the car by its sensors and by motion capture, prepared once per recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import BoolArray
from dart_hal.recording.dart.grid import Grid, grid
from dart_hal.recording.dart.model import Recording, Reference
from dart_hal.recording.dart.reference import fit_reference, rolling_reference

# Lengths in samples of 10 ms: history before the start of a window, the first start, the distance
# of starts, the reserve at the end of the recording, and the length of a window.
WINDOW_LEAD = 8
FIRST_WINDOW = 20
WINDOW_STRIDE = 25
WINDOW_TAIL = 220
WINDOW_SPAN = 207
# Speeds [m/s] of a car of 1:10: at the start of a window, and below which it is at rest.
START_SPEED = 0.3
MIN_MOVING_SPEED = 0.05
# m/s between wheels and ground, of a car of 1:10, and samples to judge it by.
MAX_SLIP_SPEED = 0.3
SLIP_ROWS = 100
# Share of bad samples above which the good ones are only pauses between failures.
MAX_BAD_MOTION_SHARE = 0.9
# Share of the driven time with slip above which the wheels do not measure the speed.
MAX_SLIP_SHARE = 0.2


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """A recording with its grid.

    grid: None without motion capture, or with too little of it. reference: marker frame of
    the recording (``with_marker_frames``), None = not known. fitted: to this recording alone,
    None where it does not identify one.
    """

    recording: Recording
    grid: Grid | None
    reference: Reference | None
    fitted: Reference | None

    @property
    def good(self) -> BoolArray:
        """(n,) samples of the grid that may be used."""
        return np.zeros(0, dtype=bool) if self.grid is None else ~self.grid.bad

    @property
    def mostly_bad(self) -> bool:
        """Whether so much of the motion capture is bad that nothing may be concluded from it."""
        return self.grid is not None and float(self.grid.bad.mean()) > MAX_BAD_MOTION_SHARE

    @property
    def moves(self) -> bool:
        """Whether anything shows that the car drove: encoder or motion capture, for 0.3 s."""
        scale = self.recording.scale.speed
        speed = self.recording.messages.speed / scale
        if int((np.nan_to_num(speed) > MIN_MOVING_SPEED).sum()) >= 3:
            return True
        return self.grid is not None and int(
            (np.hypot(self.grid.v_x, self.grid.v_y)[self.good] > START_SPEED * scale).sum()) >= 30


    @property
    def slip(self) -> float:
        """Share of the driven time in which wheels and ground differ by more than MAX_SLIP_SPEED.

        0 where one of the two is not measured.
        """
        g = self.grid
        if g is None or self.recording.encoder != "ok":
            return 0.0
        driven = self.good & (g.v_x > START_SPEED * g.scale.speed) & np.isfinite(g.encoder)
        if driven.sum() < SLIP_ROWS:
            return 0.0
        return float((np.abs(g.encoder - g.v_x)[driven] > MAX_SLIP_SPEED * g.scale.speed).mean())


def motion(recording: Recording) -> RecordedMotion:
    """Prepare the motion of a recording that ``with_marker_frames`` has returned."""
    if recording.mocap is None:
        return RecordedMotion(recording, None, None, None)
    known = recording.marker
    fitted = fit_reference([recording])
    try:
        measured = grid(recording, known or rolling_reference(recording))
        return RecordedMotion(recording, measured, known, fitted)
    except RecordingError:  # less than 0.25 s of motion capture
        return RecordedMotion(recording, None, known, None)


def windows(g: Grid) -> list[int]:
    """Return the start samples of the open-loop evaluation.

    One each 0.25 s, with v_x > START_SPEED and no bad sample in the window.

    A window needs 80 ms before its start and 2.07 s after it.
    """
    bad = np.concatenate([[0], np.cumsum(g.bad)])
    least = START_SPEED * g.scale.speed
    return [s for s in range(FIRST_WINDOW, len(g) - WINDOW_TAIL, WINDOW_STRIDE)
            if g.v_x[s] > least and bad[s + WINDOW_SPAN + 1] == bad[s - WINDOW_LEAD]]
