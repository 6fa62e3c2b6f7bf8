"""Sensors that repeat one value: they are used as missing, not as measurements."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from dart_hal.core.types import BoolArray

from .marker import marker_grid
from .model import Note, Recording, freeze

# A sensor that measures anything has noise, or follows the drive, within that many messages.
MIN_STUCK_MESSAGES = 30
# [m/s, car of 1:10] An encoder that repeats a value is stuck if the poses are faster by that.
MIN_STUCK_DIFFERENCE = 0.25
# Channels with noise, and their units; an encoder may count the same at a constant speed.
NOISY_CHANNELS = {"yaw_rate": ("gyro", "rad/s"), "accel_x": ("accelerometer x", "m/s2"),
                  "accel_y": ("accelerometer y", "m/s2")}


def drop_stuck_sensors(recording: Recording) -> Recording:
    """Return a recording without the values that a stuck sensor repeats, with notes.

    1. A channel of the IMU with one value in all messages. One that is always 0 may be that of a
       car at rest.
    2. Stretches in which the encoder repeats a value and all poses are faster: its cable broke.
    """
    messages = recording.messages
    dropped: dict[str, Any] = {}
    notes = []
    for channel, (name, unit) in NOISY_CHANNELS.items():
        values = getattr(messages, channel)
        present = values[np.isfinite(values)]
        if len(present) < MIN_STUCK_MESSAGES or not present[0] or np.ptp(present) > 0.0:
            continue
        dropped[channel] = freeze(np.full(len(values), np.nan))
        notes.append(Note(f"{name} stuck at {present[0]:.4g} {unit} in all "
                          f"{len(present)} messages: used as missing", kind="sensor_stuck"))
    encoder = recording.encoder
    if (stuck := _find_stuck_encoder(recording)).any():
        encoder = "dead" if stuck.all() else encoder
        dropped["speed"] = freeze(np.where(stuck, np.nan, messages.speed))
        notes.append(Note(f"encoder repeats a value while the poses are faster by "
                          f"{MIN_STUCK_DIFFERENCE * recording.scale.speed:.2g} m/s: used as "
                          "missing", int(stuck.sum()), "sensor_stuck"))
    if not dropped:
        return recording
    return replace(recording, messages=replace(messages, **dropped), encoder=encoder,
                   notes=(*recording.notes, *notes))


def _find_stuck_encoder(recording: Recording) -> BoolArray:
    """Mark the messages (m,) of a stuck encoder; none where it is always 0."""
    messages = recording.messages
    speed = messages.speed
    stuck = np.zeros(len(speed), dtype=bool)
    if recording.mocap is None or not np.any(np.nan_to_num(speed)):
        return stuck
    motion = marker_grid(recording)
    by_poses = np.interp(messages.arrival, motion.t, np.hypot(motion.dx, motion.dy))
    bad = np.interp(messages.arrival, motion.t, motion.bad) > 0.0
    faster = by_poses - speed > MIN_STUCK_DIFFERENCE * recording.scale.speed
    # A run of equal values in which the poses are faster ends where either changes.
    inside = faster & ~bad
    ends = np.flatnonzero((np.diff(speed) != 0.0) | (np.diff(inside) != 0)) + 1
    for first, last in pairwise([0, *ends.tolist(), len(speed)]):
        stuck[first:last] = inside[first] and last - first >= MIN_STUCK_MESSAGES
    return stuck
