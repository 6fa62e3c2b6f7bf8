"""Motion of the car at each message: from motion capture if recorded, else from its sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, savgol_derivative
from dart_hal.recording.dart.marker import marker_grid
from dart_hal.recording.dart.spans import span_index
from dart_lab.identification.prediction.windows import least_speed

# An encoder reading is the mean of the last 0.1 s, so it belongs to the middle of that time.
ENCODER_DELAY_S = 0.05
MIN_COURSE_SPEED = 0.1  # m/s of a car of 1:10; keeps the rate of the course finite at rest
MAX_MESSAGE_GAP_S = 0.3  # a longer gap between messages does not count as driving


@dataclass(frozen=True, slots=True)
class MessageMotion:
    """Speed [m/s], yaw rate and rate of the course [rad/s] by message (m,); NaN: unknown."""

    speed: FloatArray
    omega: FloatArray
    course: FloatArray


def motion_at_messages(r: Recording) -> MessageMotion:
    """Return the motion of the marker in good mocap rows; without mocap encoder and gyro.

    The course is the direction of the velocity; without motion capture it is unknown.
    """
    if r.mocap is None:
        unknown = np.full(len(r.messages), np.nan)
        return MessageMotion(r.messages.speed, r.messages.yaw_rate, unknown)
    g = marker_grid(r)
    speed = np.hypot(g.dx, g.dy)
    # course rate = (x' y'' - y' x'') / (x'^2 + y'^2)
    turn = g.dx * savgol_derivative(g.dy, 15) - g.dy * savgol_derivative(g.dx, 15)
    course = turn / np.maximum(speed, MIN_COURSE_SPEED * r.scale.speed)**2
    sample = np.rint((r.messages.arrival - ENCODER_DELAY_S) / SAMPLE).astype(np.int64)
    inside = (sample >= 0) & (sample < len(g.t))
    index = np.clip(sample, 0, len(g.t) - 1)
    good = inside & ~g.bad[index]
    return MessageMotion(*(np.where(good, v[index], np.nan) for v in (speed, g.omega, course)))


def has_sensors(r: Recording) -> bool:
    """Return whether the encoder of the car worked."""
    return r.schema != "C" and r.encoder == "ok" and bool(np.isfinite(r.messages.speed).any())


def driving_seconds(r: Recording) -> float:
    """Return the time [s] above the smallest speed of a window, by mocap or else by encoder."""
    least = least_speed(r)
    if r.mocap is not None:
        g = marker_grid(r)
        return float(((np.hypot(g.dx, g.dy) > least) & ~g.bad).sum() * SAMPLE)
    m = r.messages
    step = np.minimum(np.diff(m.t, prepend=m.t[:1]), MAX_MESSAGE_GAP_S)
    judged = span_index(r.spans, m.arrival) >= 0
    return float(step[judged & (m.speed > least)].sum())
