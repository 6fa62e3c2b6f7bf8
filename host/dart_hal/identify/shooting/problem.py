"""Stretches of recordings with their measured start, and the model's prediction of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dart_hal.errors import RecordingError
from dart_hal.identify.commands import SAMPLE, actuated
from dart_hal.recording.dart import Grid
from dart_hal.types import FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.parameters import Vehicle

CHANNELS = ("v_x", "v_y", "omega")
UNITS = ("m/s", "m/s", "rad/s")
HORIZON = 1.0  # s
EVERY = 0.5  # s from start to start: every sample is predicted twice
READ = (0.1, 0.25, 0.5, 0.75, 1.0)  # s after the start
SLOWEST = 0.3  # m/s at the start, as in the evaluation
BEFORE, AFTER = 8, 7  # samples that the velocity filter reaches beyond the window
WARM_UP = 20  # samples at the start of a recording without commands before them


@dataclass(frozen=True, slots=True)
class Problem:
    """n windows of some recordings.

    grids: of the r recordings; owner (n,): whose window; first (n,): its first
    sample there; start (6, n): measured state; measured (len(READ), 3, n):
    CHANNELS to be predicted.
    """

    grids: tuple[Grid, ...]
    owner: NDArray[np.int64]
    first: NDArray[np.int64]
    start: FloatArray
    measured: FloatArray

    @classmethod
    def of(cls, grids: Sequence[Grid], every: float = EVERY) -> Problem:
        """All good windows, ``every`` [s] one. Raises RecordingError when there is none."""
        owner, first, start, measured = [], [], [], []
        reach = np.rint(np.array(READ) / SAMPLE).astype(np.int64)
        for r, g in enumerate(grids):
            starts = windows(g, round(every / SAMPLE))
            states = np.stack([g.x, g.y, g.yaw, g.v_x, g.v_y, g.omega])
            owner.append(np.full(len(starts), r))
            first.append(starts)
            start.append(states[:, starts])
            measured.append(states[3:, starts + reach[:, None]].swapaxes(0, 1))
        if not sum(map(len, first)):
            raise RecordingError(
                "no stretch of these recordings can be predicted",
                found=f"{len(grids)} recording(s) without {HORIZON} s of good motion capture "
                      f"above {SLOWEST} m/s",
                expected="motion capture of a moving car",
                remedy="dart-hal data check FILES says what is wrong with them")
        return cls(tuple(grids), np.concatenate(owner), np.concatenate(first),
                   np.concatenate(start, axis=1), np.concatenate(measured, axis=2))

    def __len__(self) -> int:
        return len(self.first)

    def predict(self, p: Vehicle) -> FloatArray:
        """CHANNELS at READ by the model, (len(READ), 3, n)."""
        samples = round(HORIZON / SAMPLE)
        throttle, angle = np.empty((samples, len(self))), np.empty((samples, len(self)))
        rows = np.arange(samples)[:, None]
        for r, g in enumerate(self.grids):
            mine = self.owner == r
            tau, delta = actuated(p, g, smooth=True)
            at = self.first[mine] + rows
            throttle[:, mine], angle[:, mine] = tau[at], delta[at]
        states = rollout(p, self.start, throttle, angle, at=[round(t / SAMPLE) for t in READ])
        return np.asarray(states[:, 3:])

    def blocks(self, length: float) -> NDArray[np.int64]:
        """Block (n,) of each window: stretches of ``length`` [s] of one recording."""
        inside = (self.first * SAMPLE // length).astype(np.int64)
        _, out = np.unique(np.stack([self.owner, inside]), axis=1, return_inverse=True)
        return np.asarray(out.ravel())


def windows(g: Grid, stride: int) -> NDArray[np.int64]:
    """Starts of the windows of a grid that are fast enough and free of bad samples."""
    samples = round(HORIZON / SAMPLE)
    last = len(g) - samples - AFTER
    starts = np.arange(WARM_UP, max(last, WARM_UP), stride)
    bad = np.concatenate([[0], np.cumsum(g.bad)])
    clean = bad[starts + samples + AFTER] == bad[starts - BEFORE]
    return np.asarray(starts[clean & (g.v_x[starts] > SLOWEST)])
