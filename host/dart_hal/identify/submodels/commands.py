"""Commands as the actuator has them: delayed and lagged, on a grid of 0.01 s.

A row of a recording holds the command of its moment; between two rows it
changed at a time that nobody logged, so the best estimate is the straight
line between them (its errors do not bias a delay, as those of a staircase
bias delay and lag). A replay that holds each row until the next one, as
``evaluate`` does, is half a step later in the mean: ``hold``. Delays work on
continuous time (a grid step takes the mean of what falls into it).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.identify.commands import following
from dart_hal.identify.runs import RUN
from dart_hal.recording.dart import Recording
from dart_hal.types import FloatArray

DT = 0.01  # s


@dataclass(frozen=True, slots=True)
class Command:
    """Command (m,) at t (m,) s, straight lines between; before and after: the end values.

    hold [s]: how much later a replay of held rows is in the mean; 0 for our
    own runs, whose commands are known frame by frame.
    """

    t: FloatArray
    value: FloatArray
    hold: float

    def on_grid(self, start: float, n: int, delay: float = 0.0, lag: float = 0.0) -> FloatArray:
        """(n,) means over [start + i DT, start + (i + 1) DT], ``delay`` [s] later, then lagged.

        lag [s]: first order, settled at the start; what a step holds is what
        the lag has reached at its middle.
        """
        edges = start + DT * np.arange(n + 1) - delay
        inside = np.clip(edges, self.t[0], self.t[-1])
        step, rise = np.diff(self.t), np.diff(self.value)
        area = np.concatenate([[0.0], np.cumsum((self.value[:-1] + 0.5 * rise) * step)])
        i = np.clip(np.searchsorted(self.t, inside, side="right") - 1, 0, len(step) - 1)
        gone = inside - self.t[i]
        slope = rise[i] / np.maximum(step[i], 1e-9)
        total = area[i] + (self.value[i] + 0.5 * slope * gone) * gone
        total = total + np.where(edges < self.t[0], self.value[0], self.value[-1]) * (
            edges - inside)
        return lagged(np.diff(total) / DT, lag)


def step_of(recording: Recording) -> float:
    """Median time [s] from message to message."""
    step = np.diff(recording.messages.t)
    return float(np.median(step)) if len(step) else 0.1


def throttle_of(recording: Recording, stamp: FloatArray) -> Command:
    """Throttle behind the gate at stamp (m,) s."""
    return Command(stamp, recording.messages.throttle, _hold(recording))


def steering_of(recording: Recording, stamp: FloatArray) -> Command:
    """Steering at stamp (m,) s; ours is the mean of the step that ends at the stamp."""
    shift = 0.5 * step_of(recording) if recording.schema == RUN else 0.0
    return Command(stamp - shift, recording.messages.steering, _hold(recording))


def _hold(recording: Recording) -> float:
    return 0.0 if recording.schema == RUN else 0.5 * step_of(recording)


def lagged(u: FloatArray, lag: float) -> FloatArray:
    """First-order lag [s] of u (..., n) on the grid, settled at u[..., 0], step middles."""
    if lag < 1e-4:
        return u
    keep = float(np.exp(-DT / lag))
    half = float(np.exp(-0.5 * DT / lag))
    # state at the edge before a step, then half a step towards that step's command
    edge = following(u, keep)
    return np.asarray(half * edge + (1.0 - half) * u)
