"""Commands as the actuator has them: delayed and lagged, on a grid of 0.01 s.

The recorder holds a command until the next message, so the series is a
staircase; it is delayed as a function of continuous time (each grid step
takes the mean of what falls into it), never by whole samples. Recorders of
the DART files show a command 0 to 0.1 s after it was given: what is counted
here begins when the log shows it. In our own runs the frames are known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.identify.runs import RUN
from dart_hal.recording.dart import Recording
from dart_hal.types import FloatArray

DT = 0.01  # s


@dataclass(frozen=True, slots=True)
class Staircase:
    """Command (m,) held from stamp t (m,) s; before the first stamp its value."""

    t: FloatArray
    value: FloatArray

    def on_grid(self, start: float, n: int, delay: float = 0.0, lag: float = 0.0) -> FloatArray:
        """(n,) means over [start + i DT, start + (i + 1) DT], ``delay`` [s] later, then lagged.

        lag [s]: first order, settled at the start; what a step holds is what
        the lag has reached at its middle.
        """
        edges = start + DT * np.arange(n + 1) - delay
        area = np.concatenate([[0.0], np.cumsum(self.value[:-1] * np.diff(self.t))])
        index = np.clip(np.searchsorted(self.t, edges, side="right") - 1, 0, None)
        total = area[index] + self.value[index] * (edges - self.t[index])
        return lagged(np.diff(total) / DT, lag)


def step_of(recording: Recording) -> float:
    """Median time [s] from message to message."""
    step = np.diff(recording.messages.t)
    return float(np.median(step)) if len(step) else 0.1


def throttle_stairs(recording: Recording, stamp: FloatArray) -> Staircase:
    """Throttle behind the gate. Ours: the last frame of a step, so it changed half a step ago."""
    shift = 0.5 * step_of(recording) if recording.schema == RUN else 0.0
    return Staircase(stamp - shift, recording.messages.throttle)


def steering_stairs(recording: Recording, stamp: FloatArray) -> Staircase:
    """Steering. Ours: the mean of the step that ends at the stamp."""
    shift = step_of(recording) if recording.schema == RUN else 0.0
    return Staircase(stamp - shift, recording.messages.steering)


def lagged(u: FloatArray, lag: float) -> FloatArray:
    """First-order lag [s] of u (..., n) on the grid, settled at u[..., 0], step middles."""
    if lag < 1e-4:
        return u
    from scipy.signal import lfilter

    keep = float(np.exp(-DT / lag))
    half = float(np.exp(-0.5 * DT / lag))
    # state at the edge before a step, then half a step towards that step's command
    edge, _ = lfilter([0.0, 1.0 - keep], [1.0, -keep], u, zi=np.atleast_1d(u[..., 0]))
    return np.asarray(half * edge + (1.0 - half) * u)
