"""Which stretches of a recording a model is asked to predict.

No window holds a sample that the mocap got wrong, from the reach of the velocity
filter before it to its end. As open-loop evaluation is defined, one starts every
0.25 s and serves all horizons, so that errors at 0.5, 1 and 2 s are about the same drives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, IntArray
from dart_hal.recording.dart import Grid

HORIZONS = (0.5, 1.0, 2.0)
"""s; the last is the length of a window of the evaluation."""
LENGTH = round(HORIZONS[-1] / SAMPLE)
FIRST, EVERY, CLEAN, TAIL = 20, 25, 208, 220
"""Samples: first start (no command is known before a recording), distance of starts; and how much
after a start, as the evaluation has it, must be free of bad samples, and must follow at all."""
BEFORE = 8
"""Samples before a start among which none may be bad."""
MIN_SPEED = 0.3
"""m/s; below it the dynamic model is not to be trusted, nor scored."""


@dataclass(frozen=True, slots=True)
class Windows:
    """start (n,): samples of the grid; and how many candidates were left out, and why."""

    start: IntArray
    slow: int
    bad: int

    def __len__(self) -> int:
        return len(self.start)


def find_windows(g: Grid, every: int = EVERY, clean: int = CLEAN, tail: int = TAIL) -> Windows:
    """Windows of a recording, in the order of time.

    Samples: every: from start to start; clean: from a start on, none of which may be
    bad; tail: more than so many follow a start.
    """
    start: IntArray = np.arange(FIRST, max(len(g) - tail, FIRST), every, dtype=np.int64)
    total = np.concatenate([[0], np.cumsum(g.bad)])
    sound = total[start + clean] == total[start - BEFORE]
    moves = g.v_x[start] > MIN_SPEED
    return Windows(start[sound & moves], int((~moves).sum()), int((moves & ~sound).sum()))


def covered(windows: Windows, n: int) -> BoolArray:
    """(n,): the samples that lie in a window of the evaluation."""
    edge = np.zeros(n + 1, dtype=np.int64)
    np.add.at(edge, windows.start, 1)
    np.add.at(edge, np.minimum(windows.start + LENGTH + 1, n), -1)
    return np.asarray(np.cumsum(edge[:-1]) > 0)
