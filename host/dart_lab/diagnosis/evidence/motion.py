"""How the car moved at each message, from the mocap where there is one, else from its sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, savgol_derivative
from dart_hal.recording.dart.marker import marker_grid
from dart_hal.recording.dart.spans import span_index
from dart_lab.identification.prediction.windows import MIN_SPEED

DELAY = 0.05  # s; an encoder's reading is the mean of the last 0.1 s


@dataclass(frozen=True, slots=True)
class AtMessages:
    """By message (m,): speed [m/s], yaw rate and rate of the course [rad/s], NaN: not known."""

    speed: FloatArray
    omega: FloatArray
    course: FloatArray


def at_messages(r: Recording) -> AtMessages:
    """Mocap: of the marker, over the good rows; without: encoder and gyro, no course."""
    if r.mocap is None:
        nothing = np.full(len(r.messages), np.nan)
        return AtMessages(r.messages.speed, r.messages.yaw_rate, nothing)
    g = marker_grid(r)
    speed = np.hypot(g.dx, g.dy)
    turn = g.dx * savgol_derivative(g.dy, 15) - g.dy * savgol_derivative(g.dx, 15)
    course = turn / np.maximum(speed, 0.1)**2
    when = np.rint((r.messages.arrival - DELAY) / SAMPLE).astype(np.int64)
    inside = (when >= 0) & (when < len(g.t))
    at = np.clip(when, 0, len(g.t) - 1)
    good = inside & ~g.bad[at]
    return AtMessages(*(np.where(good, v[at], np.nan) for v in (speed, g.omega, course)))


def has_sensors(r: Recording) -> bool:
    """Whether the car's own encoder worked."""
    return r.schema != "C" and r.encoder == "ok" and bool(np.isfinite(r.messages.speed).any())


def driving_seconds(r: Recording) -> float:
    """How long [s] it drove faster than a window may start, by the mocap or else its encoder."""
    if r.mocap is not None:
        g = marker_grid(r)
        return float(((np.hypot(g.dx, g.dy) > MIN_SPEED) & ~g.bad).sum() * SAMPLE)
    m = r.messages
    step = np.minimum(np.diff(m.t, prepend=m.t[:1]), 0.3)
    judged = span_index(r.spans, m.arrival) >= 0
    return float(step[judged & (m.speed > MIN_SPEED)].sum())
