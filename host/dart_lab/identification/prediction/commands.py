"""Commands of a recording as series on the grid of 0.01 s.

A message has the command at its time. ``zero_order_hold`` holds it until the next message, on the
clock of the senders, which is what drove the car. In rows that were logged without that clock, a
command changed at an unknown time between two rows. ``LoggedCommand`` interpolates linearly: its
errors do not bias a delay, while those of a staircase bias delay and lag. A replay that holds each
row until the next one, as ``evaluate`` does, is delayed by half a step in the mean: ``hold``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Messages, Recording
from dart_hal.vehicle.delay import first_order_lag

# Quantile of the delay between sending and arrival that is taken as no delay.
PROMPT_QUANTILE = 0.02


@dataclass(frozen=True, slots=True)
class LoggedCommand:
    """Command (m,) at t (m,) [s], linear between; before and after: the end values.

    hold [s]: mean delay of a replay of held rows; 0 for own runs, whose commands are known frame
    by frame.
    """

    t: FloatArray
    value: FloatArray
    hold: float

    def on_grid(self, start: float, n: int, delay: float = 0.0, lag: float = 0.0) -> FloatArray:
        """Return the means (n,) over samples from ``start`` [s] on, delayed and lagged.

        delay [s]; lag [s]: of first order, in steady state at the start; a sample has the output
        of the lag at its middle.
        """
        # The mean of a piecewise linear function is a difference of its integral, which is a
        # parabola between two points and a straight line beyond the ends.
        edges = start + SAMPLE * np.arange(n + 1) - delay
        inside = np.clip(edges, self.t[0], self.t[-1])
        step = np.diff(self.t)
        rise = np.diff(self.value)
        area = np.concatenate([[0.0], np.cumsum((self.value[:-1] + 0.5 * rise) * step)])
        i = np.clip(np.searchsorted(self.t, inside, side="right") - 1, 0, len(step) - 1)
        elapsed = inside - self.t[i]
        slope = rise[i] / np.maximum(step[i], 1e-9)
        total = area[i] + (self.value[i] + 0.5 * slope * elapsed) * elapsed
        total = total + np.where(edges < self.t[0], self.value[0], self.value[-1]) * (
            edges - inside)
        return first_order_lag(np.diff(total) / SAMPLE, lag, "middle")


def message_step(recording: Recording) -> float:
    """Return the time [s] that a message covers: the span of means, else the median step."""
    step = np.diff(recording.messages.t)
    return recording.span or (float(np.median(step)) if len(step) else 0.1)


def throttle_of(recording: Recording, stamp: FloatArray) -> LoggedCommand:
    """Return the throttle behind the gate at stamp (m,) [s]."""
    return LoggedCommand(stamp, recording.messages.throttle, _hold(recording))


def steering_of(recording: Recording, stamp: FloatArray) -> LoggedCommand:
    """Return the steering at stamp (m,) [s]; means of the step before it are at its middle."""
    shift = 0.5 * message_step(recording) if recording.of_means else 0.0
    return LoggedCommand(stamp - shift, recording.messages.steering, _hold(recording))


def _hold(recording: Recording) -> float:
    return 0.0 if recording.of_means else 0.5 * message_step(recording)


def message_time(m: Messages) -> FloatArray:
    """Return when each message was sent (m,) [s], on the clock of the mocap.

    The stamps of the sensor node are regular; arrivals are delayed by the line, the loop and the
    next mocap row. The arrivals with the least delay relate the two clocks.
    """
    return np.asarray(m.t + np.quantile(m.arrival - m.t, PROMPT_QUANTILE))


def zero_order_hold(t: FloatArray, value: FloatArray, n: int) -> FloatArray:
    """Return the mean (n,) over each sample of a command that is held between messages (m,)."""
    since = np.concatenate([[min(t[0], 0.0) - 1.0], t[1:]])
    total = np.concatenate([[0.0], np.cumsum(np.diff(since) * value[:-1])])
    edges = np.arange(n + 1) * SAMPLE
    integral = np.interp(edges, since, total) + np.maximum(edges - since[-1], 0.0) * value[-1]
    return _round_sums(np.diff(integral) / SAMPLE)


def spread_over(command: FloatArray, spread: float) -> FloatArray:
    """Average a series (n,) over a jitter of up to ``spread`` [s] in both directions."""
    if 2.0 * spread <= SAMPLE:
        return command
    total = np.concatenate([[0.0], np.cumsum(command)])
    edges = np.arange(len(total), dtype=np.float64)
    middle = edges[:-1] + 0.5
    reach = spread / SAMPLE
    low, high = (np.clip(middle + r, 0.0, len(command)) for r in (-reach, reach))
    difference = np.interp(high, edges, total) - np.interp(low, edges, total)
    return _round_sums(difference / (high - low))


def catmull_rom(series: FloatArray, positions: FloatArray) -> FloatArray:
    """Interpolate a series (n,) at positions (..., k) [samples] by Catmull-Rom cubics.

    Or several series (s, n), each at its own positions (s, k). The error of linear interpolation
    depends on the curvature and the age of the messages, and would make the loss rough in that age.
    """
    last = series.shape[-1] - 1
    positions = np.minimum(np.maximum(positions, 0.0), last)
    i = np.minimum(positions.astype(np.int64), last - 1)
    u = positions - i
    row = (last + 1) * np.arange(len(series))[:, None] if series.ndim == 2 else 0
    a, b, c, d = (series.ravel()[row + k] for k in (
        np.maximum(i - 1, 0), i, i + 1, np.minimum(i + 2, last)))
    return np.asarray(b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d
                                                  + u * (3.0 * (b - c) + d - a))))


def _round_sums(command: FloatArray) -> FloatArray:
    """Round differences of sums, so that a constant command is constant to the last bit."""
    return np.round(command, 9)
