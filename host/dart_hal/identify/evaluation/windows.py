"""Which stretches of a recording a model is asked to predict.

A window starts every 0.25 s and serves all horizons, so that errors at 0.5, 1
and 2 s are about the same drives. No window holds a sample that the mocap got
wrong, from the reach of the velocity filter before it to its end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.recording.dart import Grid
from dart_hal.types import BoolArray, IntArray

HORIZONS = (0.5, 1.0, 2.0)
"""s; the last is the length of a window."""
SAMPLE = 0.01
FIRST, EVERY, TAIL = 20, 25, 220
"""Samples: first start, distance of starts, and how much must follow a start."""
BEFORE, AFTER = 8, 207
"""Samples before and after a start among which none may be bad."""
MIN_SPEED = 0.3
"""m/s; below it the dynamic model is not to be trusted, nor scored."""
LENGTH = round(HORIZONS[-1] / SAMPLE)


@dataclass(frozen=True, slots=True)
class Windows:
    """start (n,): samples of the grid; and how many candidates were left out, and why."""

    start: IntArray
    slow: int
    bad: int

    def __len__(self) -> int:
        return len(self.start)


def find_windows(g: Grid) -> Windows:
    """Windows of 2 s of a recording, in the order of time."""
    start: IntArray = np.arange(FIRST, max(len(g) - TAIL, FIRST), EVERY, dtype=np.int64)
    total = np.concatenate([[0], np.cumsum(g.bad)])
    clean = total[start + AFTER + 1] == total[start - BEFORE]
    moves = g.v_x[start] > MIN_SPEED
    return Windows(start[clean & moves], int((~moves).sum()), int((moves & ~clean).sum()))


def covered(windows: Windows, n: int) -> BoolArray:
    """(n,): the samples that lie in a window."""
    edge = np.zeros(n + 1, dtype=np.int64)
    np.add.at(edge, windows.start, 1)
    np.add.at(edge, np.minimum(windows.start + LENGTH + 1, n), -1)
    return np.asarray(np.cumsum(edge[:-1]) > 0)
