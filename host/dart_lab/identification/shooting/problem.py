"""Stretches of recordings with their measured start, and the model's prediction of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Grid
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.rollout import Parts, measured, predict
from dart_lab.identification.prediction.windows import MIN_SPEED, find_windows

CHANNELS = ("v_x", "v_y", "omega")
UNITS = ("m/s", "m/s", "rad/s")
HORIZON = 1.0  # s
EVERY = 0.5  # s from start to start: every sample is predicted twice
READ = (0.1, 0.25, 0.5, 0.75, 1.0)  # s after the start
AT = tuple(round(t / SAMPLE) for t in READ)
AFTER = 7  # samples that the velocity filter reaches beyond the window


@dataclass(frozen=True, slots=True)
class Problem:
    """n windows of some recordings.

    parts: the recordings with the first samples of their windows; measured
    (len(READ), 3, n): CHANNELS to be predicted; waits [s]: by recording, standard
    error of how long its commands waited for their pulse, () = of none.
    """

    parts: Parts
    measured: FloatArray
    waits: tuple[float, ...] = ()

    @classmethod
    def of(cls, grids: Sequence[Grid], every: float = EVERY) -> Problem:
        """All good windows, ``every`` [s] one. Raises RecordingError when there is none."""
        clean = AT[-1] + AFTER
        starts = [find_windows(g, round(every / SAMPLE), clean, clean).start for g in grids]
        parts = [(g, first[_fast(g, first)]) for g, first in zip(grids, starts, strict=True)]
        if not any(len(first) for _, first in parts):
            raise RecordingError(
                "no stretch of these recordings can be predicted",
                found=f"{len(grids)} recording(s) without {HORIZON} s of good motion capture "
                      f"above {MIN_SPEED} m/s",
                expected="motion capture of a moving car",
                remedy="dart-hal data check FILES says what is wrong with them")
        return cls(parts, measured(parts, AT)[:, 3:])

    def __len__(self) -> int:
        return int(self.measured.shape[-1])

    def frame_errors(self, which: int) -> FloatArray:
        """Standard error (n,) of L_x [m] (0), theta [rad] (1), L_y [m] (2) of each window's
        marker frame; 0 where it is not known."""
        errors = [0.0 if g.reference.std is None or not np.isfinite(g.reference.std[which])
                  else g.reference.std[which] for g, _ in self.parts]
        return np.repeat(errors, [len(first) for _, first in self.parts])

    def predict(self, p: Vehicle, shift: float = 0.0) -> FloatArray:
        """CHANNELS at READ by the model, (len(READ), 3, n).

        Samples hold the mean of what a lag has reached: continuous down to no lag at all.
        shift [m]: the centre of mass of the model ahead of that of the measured motion. The
        prediction is that of the measured point: v_y there is v_y - shift omega.
        """
        parts = self.parts if not shift else [
            (replace(g, v_y=g.v_y + shift * g.omega), first) for g, first in self.parts]
        out = np.asarray(predict(p, parts, AT, smooth=True, sampled="mean")[:, 3:])
        if shift:
            out[:, 1] -= shift * out[:, 2]
        return out


def _fast(g: Grid, first: IntArray) -> BoolArray:
    """Whether a window (n,) stays above MIN_SPEED until its last read-out.

    Where a car comes to rest its measured velocity is smoothed over the stop, which friction at
    rest would have to explain.
    """
    return np.asarray(np.all([g.v_x[first + at] > MIN_SPEED for at in AT], axis=0))
