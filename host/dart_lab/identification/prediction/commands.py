"""Commands of a recording as series on the grid of 0.01 s.

A message holds the command of its moment. ``zero_order_hold`` keeps it until the
next message, on the clock of the senders: what drove the car. Where rows were
logged without their senders' clock, a command changed between two of them at a
time that nobody knows; ``Command`` takes the straight line, whose errors do not
bias a delay, as those of a staircase bias delay and lag. A replay that holds each
row until the next one, as ``evaluate`` does, is half a step later in the mean: ``hold``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Messages, Recording
from dart_hal.vehicle.delay import first_order_lag

PROMPT = 0.02  # quantile of the delay between sending and arrival that stands for "at once"


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
        """(n,) means over each sample from ``start`` [s] on, ``delay`` [s] later, then lagged.

        lag [s]: first order, settled at the start; what a sample holds is what
        the lag has reached at its middle.
        """
        edges = start + SAMPLE * np.arange(n + 1) - delay
        inside = np.clip(edges, self.t[0], self.t[-1])
        step, rise = np.diff(self.t), np.diff(self.value)
        area = np.concatenate([[0.0], np.cumsum((self.value[:-1] + 0.5 * rise) * step)])
        i = np.clip(np.searchsorted(self.t, inside, side="right") - 1, 0, len(step) - 1)
        gone = inside - self.t[i]
        slope = rise[i] / np.maximum(step[i], 1e-9)
        total = area[i] + (self.value[i] + 0.5 * slope * gone) * gone
        total = total + np.where(edges < self.t[0], self.value[0], self.value[-1]) * (
            edges - inside)
        return first_order_lag(np.diff(total) / SAMPLE, lag, "middle")


def step_of(recording: Recording) -> float:
    """s that a message stands for: of means their span, else the median time to the next one."""
    step = np.diff(recording.messages.t)
    return recording.span or (float(np.median(step)) if len(step) else 0.1)


def throttle_of(recording: Recording, stamp: FloatArray) -> Command:
    """Throttle behind the gate at stamp (m,) s."""
    return Command(stamp, recording.messages.throttle, _hold(recording))


def steering_of(recording: Recording, stamp: FloatArray) -> Command:
    """Steering at stamp (m,) s; means of the step that ends at the stamp belong to its middle."""
    shift = 0.5 * step_of(recording) if recording.of_means else 0.0
    return Command(stamp - shift, recording.messages.steering, _hold(recording))


def _hold(recording: Recording) -> float:
    return 0.0 if recording.of_means else 0.5 * step_of(recording)


def message_time(m: Messages) -> FloatArray:
    """When each message was sent (m,) [s], on the clock of the mocap.

    The sensor node's own stamps are steady; arrival waits for the line, the
    loop and the next mocap row. The promptest arrivals tie the two clocks.
    """
    return np.asarray(m.t + np.quantile(m.arrival - m.t, PROMPT))


def zero_order_hold(t: FloatArray, value: FloatArray, n: int) -> FloatArray:
    """Mean of a command over each sample (n,), held from message (m,) to message."""
    since = np.concatenate([[min(t[0], 0.0) - 1.0], t[1:]])
    total = np.concatenate([[0.0], np.cumsum(np.diff(since) * value[:-1])])
    edges = np.arange(n + 1) * SAMPLE
    integral = np.interp(edges, since, total) + np.maximum(edges - since[-1], 0.0) * value[-1]
    return _level(np.diff(integral) / SAMPLE)


def spread_over(command: FloatArray, spread: float) -> FloatArray:
    """A series (n,) that comes up to ``spread`` [s] earlier or later: what it is in the mean."""
    if 2.0 * spread <= SAMPLE:
        return command
    total = np.concatenate([[0.0], np.cumsum(command)])
    edges = np.arange(len(total), dtype=np.float64)
    middle, reach = edges[:-1] + 0.5, spread / SAMPLE
    low, high = (np.clip(middle + r, 0.0, len(command)) for r in (-reach, reach))
    return _level((np.interp(high, edges, total) - np.interp(low, edges, total)) / (high - low))


def catmull_rom(series: FloatArray, at: FloatArray) -> FloatArray:
    """A series (n,) at times (..., k) in samples: cubic through four samples (Catmull-Rom).

    Or series (s, n), each at times of its own (s, k).

    Straight lines would be off by what a signal bends within a sample, more or
    less of it at every age of the messages, and the loss rough along that age.
    """
    last = series.shape[-1] - 1
    at = np.minimum(np.maximum(at, 0.0), last)
    i = np.minimum(at.astype(np.int64), last - 1)
    u = at - i
    row = (last + 1) * np.arange(len(series))[:, None] if series.ndim == 2 else 0
    a, b, c, d = (series.ravel()[row + k] for k in (
        np.maximum(i - 1, 0), i, i + 1, np.minimum(i + 2, last)))
    return np.asarray(b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d
                                                  + u * (3.0 * (b - c) + d - a))))


def _level(command: FloatArray) -> FloatArray:
    """What stands still does so to the last bit: differences of sums do not."""
    return np.round(command, 9)
