"""Stretches of recordings with their measured start, and the model's prediction of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.errors import RecordingError
from dart_hal.predict.rollout import Parts, measured, predict
from dart_hal.predict.windows import MIN_SPEED, find_windows
from dart_hal.recording.dart import Grid
from dart_hal.types import SAMPLE, FloatArray
from dart_hal.vehicle.parameters import Vehicle

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
    (len(READ), 3, n): CHANNELS to be predicted.
    """

    parts: Parts
    measured: FloatArray

    @classmethod
    def of(cls, grids: Sequence[Grid], every: float = EVERY) -> Problem:
        """All good windows, ``every`` [s] one. Raises RecordingError when there is none."""
        clean = AT[-1] + AFTER
        parts = [(g, find_windows(g, round(every / SAMPLE), clean, clean).start) for g in grids]
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

    def predict(self, p: Vehicle) -> FloatArray:
        """CHANNELS at READ by the model, (len(READ), 3, n).

        Samples hold the mean of what a lag has reached: continuous down to no lag at all.
        """
        return np.asarray(predict(p, self.parts, AT, smooth=True, sampled="mean")[:, 3:])
