"""What a standing car tells: its gyro and accelerometer say what they read of nothing.

While driving an accelerometer shakes a hundred times as much as a tilt of a
degree shows; ten messages of a car at rest say more than a minute of driving.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Messages
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA

from ..policy import MIN_READINGS, EvidencePolicy

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def standing(stands: BoolArray, m: Messages, rows: IntArray, held: float) -> IntArray:
    """Places in rows of messages between others that all saw a standing car.

    stands (len(rows),): the car does not move at the message. held [rad/s]: one that turns
    more is being carried.
    """
    stands = stands.copy()
    stands[1:-1] &= stands[:-2] & stands[2:]
    stands[[0, -1]] = False
    for channel in (m.yaw_rate, m.accel_x, m.accel_y):
        stands &= np.isfinite(channel[rows])
    if not stands.any():
        return np.empty(0, dtype=np.int64)
    rate = m.yaw_rate[rows]
    return np.flatnonzero(stands & (np.abs(rate - np.median(rate[stands])) < held))


def shaking(m: Messages, driven: IntArray, still: IntArray, policy: EvidencePolicy) -> FloatArray:
    """(2,): by how much a_x and a_y are noisier at some messages than at others; at least 1."""
    return np.asarray(np.maximum(_noise(m, driven, policy) / _noise(m, still, policy), 1.0))


def dithered(read: FloatArray, index: IntArray) -> FloatArray:
    """Readings (k, 4) at rest, anywhere within their step: what is rounded has no noise of its own.

    Evenly spread instead of by chance, so that the same file gives the same numbers.
    """
    out = np.array(read[index])
    for k in (1, 2, 3):
        values = np.unique(read[np.isfinite(read[:, k]), k])
        steps = np.diff(values)
        steps = steps[steps > 1e-5]
        out[:, k] += spread(len(out)) * (steps.min() if len(steps) else 0.0)
    return out


def spread(n: int) -> FloatArray:
    """n numbers evenly over -0.5 to 0.5 in no order that means anything."""
    return np.asarray((GOLDEN * np.arange(1, n + 1)) % 1.0 - 0.5)


def _noise(m: Messages, index: IntArray, policy: EvidencePolicy) -> FloatArray:
    """Robust standard deviation of (a_x, a_y) from message to message, at least ``level``."""
    steps = np.diff(np.stack([m.accel_x[index], m.accel_y[index]]), axis=1)
    if steps.shape[1] < MIN_READINGS or not np.isfinite(steps).all():
        return np.full(2, policy.level)
    size = MAD_TO_SIGMA / np.sqrt(2.0) * np.median(np.abs(steps), axis=1)
    return np.asarray(np.maximum(size, policy.level))
