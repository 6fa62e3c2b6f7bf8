"""How the car moved by its own sensors and by motion capture, prepared once per recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.errors import RecordingError
from dart_hal.recording.dart.grid import L_R, Grid, grid
from dart_hal.recording.dart.model import Recording, Reference
from dart_hal.recording.dart.reference import fit_reference, reference_for
from dart_hal.types import BoolArray

UNKNOWN = Reference(L_R, 0.0, 0.0, "not known: markers taken to sit at the centre of mass")
LEAD, FIRST, STRIDE, TAIL, SPAN = 8, 20, 25, 220, 207  # samples of 10 ms
START_SPEED = 0.3  # m/s
STANDING = 0.05  # m/s; below it the car stands
SLIP, SLIP_ROWS = 0.3, 100  # m/s between wheels and ground; samples to judge it by
SLIPS = 0.2  # of the driven time; then the wheels tell no speed


@dataclass(frozen=True, slots=True)
class Motion:
    """A recording with its grid.

    grid: None without motion capture, or with too little of it. reference: by
    date, None = not known. fitted: from this recording, None without turns to
    both sides.
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
    def moves(self) -> bool:
        """Whether anything shows that the car drove: encoder or motion capture, for 0.3 s."""
        speed = self.recording.messages.speed
        if int((np.nan_to_num(speed) > STANDING).sum()) >= 3:
            return True
        return self.grid is not None and int(
            (np.hypot(self.grid.v_x, self.grid.v_y)[self.good] > START_SPEED).sum()) >= 30


    @property
    def slip(self) -> float:
        """Share of the driven time in which wheels and ground differ by more than 0.3 m/s.

        0 where one of the two is not measured.
        """
        g = self.grid
        if g is None or self.recording.encoder != "ok":
            return 0.0
        driven = self.good & (g.v_x > START_SPEED) & np.isfinite(g.encoder)
        if driven.sum() < SLIP_ROWS:
            return 0.0
        return float((np.abs(g.encoder - g.v_x)[driven] > SLIP).mean())


def motion(recording: Recording) -> Motion:
    """Grid and reference point of ``recording``, as far as it has any."""
    if recording.mocap is None:
        return Motion(recording, None, None, None)
    known = reference_for(recording)
    fitted = fit_reference([recording])
    try:
        return Motion(recording, grid(recording, known or fitted or UNKNOWN), known, fitted)
    except RecordingError:  # less than 0.25 s of motion capture
        return Motion(recording, None, known, None)


def windows(g: Grid) -> list[int]:
    """Start samples of the open-loop evaluation: every 0.25 s, v_x > 0.3 m/s, nothing bad.

    A window needs 80 ms before its start and 2.07 s after it.
    """
    bad = np.concatenate([[0], np.cumsum(g.bad)])
    return [s for s in range(FIRST, len(g) - TAIL, STRIDE)
            if g.v_x[s] > START_SPEED and bad[s + SPAN + 1] == bad[s - LEAD]]
