"""Windows of a recording for open-loop prediction.

No window contains a bad sample of the mocap, from the reach of the velocity filter before its
start to its end. As open-loop evaluation is defined, one starts every 0.25 s and serves all
horizons, so that errors at 0.5, 1 and 2 s are of the same drives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, IntArray
from dart_hal.recording.dart import Grid, Recording

# [s] The last is the length of a window of the evaluation.
HORIZONS = (0.5, 1.0, 2.0)
WINDOW_LENGTH = round(HORIZONS[-1] / SAMPLE)
# Samples before the first start: no command is known before a recording.
FIRST_START = 20
# Samples from start to start.
START_STRIDE = 25
# Samples after a start that must be good, as the evaluation is defined.
CLEAN_SAMPLES = 208
# Samples that must follow a start.
MIN_FOLLOWING = 220
# Samples before a start that must be good.
CLEAN_BEFORE = 8
# [m/s] The dynamic model of a car of 1:10 is neither valid nor scored below it.
MIN_WINDOW_SPEED = 0.3
# Throttle below which the ESC brakes a car that rolls forward, which no model describes, or
# reverses it, which an encoder without a sign does not show.
MIN_FORWARD_THROTTLE = -0.01
# [s] The throttle acts on the car for so long after its command.
THROTTLE_MEMORY = 0.5


@dataclass(frozen=True, slots=True)
class Windows:
    """Starts (n,) [samples of the grid], and how many candidates were too slow or bad."""

    start: IntArray
    slow: int
    bad: int

    def __len__(self) -> int:
        return len(self.start)


def find_windows(g: Grid, every: int = START_STRIDE, clean: int = CLEAN_SAMPLES,
                 tail: int = MIN_FOLLOWING) -> Windows:
    """Find the windows of a recording, in the order of time.

    every: samples from start to start; clean: samples after a start that must be good; tail: more
    than that many samples must follow a start.
    """
    start: IntArray = np.arange(FIRST_START, max(len(g) - tail, FIRST_START), every, dtype=np.int64)
    total = np.concatenate([[0], np.cumsum(g.bad)])
    sound = total[start + clean] == total[start - CLEAN_BEFORE]
    moves = g.v_x[start] > MIN_WINDOW_SPEED * g.scale.speed
    return Windows(start[sound & moves], int((~moves).sum()), int((moves & ~sound).sum()))


def is_forward(g: Grid, start: IntArray, length: int) -> BoolArray:
    """Return whether the throttle never brakes in each window (n,) of ``length`` samples."""
    brakes = np.concatenate([[0], np.cumsum(g.throttle < MIN_FORWARD_THROTTLE)])
    first = np.maximum(start - round(THROTTLE_MEMORY / SAMPLE), 0)
    return np.asarray(brakes[np.minimum(start + length, len(g))] == brakes[first])


def least_speed(recording: Recording) -> float:
    """Return the speed [m/s] above which a window of a recording starts."""
    return MIN_WINDOW_SPEED * recording.scale.speed


def is_covered(windows: Windows, n: int) -> BoolArray:
    """Return whether each sample (n,) is in a window of the evaluation."""
    edge = np.zeros(n + 1, dtype=np.int64)
    np.add.at(edge, windows.start, 1)
    np.add.at(edge, np.minimum(windows.start + WINDOW_LENGTH + 1, n), -1)
    return np.asarray(np.cumsum(edge[:-1]) > 0)
