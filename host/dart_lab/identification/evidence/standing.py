"""Messages of a car at rest: what its gyro and accelerometer read without motion.

While driving, vibration of the accelerometer is a hundred times larger than the effect of a tilt
of one degree. Ten messages at rest determine a bias or tilt better than a minute of driving.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Messages
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA

from .policy import MIN_READINGS, EvidencePolicy

GOLDEN_RATIO = 0.5 * (np.sqrt(5.0) - 1.0)
MIN_RESOLUTION = 1e-5  # a smaller difference between readings is rounding of floats


def find_rest_messages(at_rest: BoolArray, m: Messages, rows: IntArray, max_yaw_rate: float
                       ) -> IntArray:
    """Find places in ``rows`` of messages at rest, between two others at rest.

    at_rest (len(rows),): the car does not move at the message. max_yaw_rate [rad/s]: a car that
    turns more is being carried.
    """
    at_rest = at_rest.copy()
    at_rest[1:-1] &= at_rest[:-2] & at_rest[2:]
    at_rest[[0, -1]] = False
    for channel in (m.yaw_rate, m.accel_x, m.accel_y):
        at_rest &= np.isfinite(channel[rows])
    if not at_rest.any():
        return np.empty(0, dtype=np.int64)
    rate = m.yaw_rate[rows]
    # the bias of the gyro is the median at rest: only the rate relative to it is motion
    turning = np.abs(rate - np.median(rate[at_rest]))
    return np.flatnonzero(at_rest & (turning < max_yaw_rate))


def driving_noise_scale(m: Messages, driving: IntArray, rest: IntArray, policy: EvidencePolicy
                        ) -> FloatArray:
    """Return the noise of a_x and a_y (2,) while driving over that at rest, at least 1."""
    ratio = _accel_noise(m, driving, policy) / _accel_noise(m, rest, policy)
    return np.asarray(np.maximum(ratio, 1.0))


def add_dither(readings: FloatArray, index: IntArray) -> FloatArray:
    """Return readings (k, 4) at rest, spread over their quantisation step.

    Rounded readings at rest are often all equal, so they show no noise. The dither is a fixed
    sequence and not random, so that the same file always gives the same numbers.
    """
    out = np.array(readings[index])
    for k in (1, 2, 3):
        values = np.unique(readings[np.isfinite(readings[:, k]), k])
        steps = np.diff(values)
        steps = steps[steps > MIN_RESOLUTION]
        out[:, k] += uniform_sequence(len(out)) * (steps.min() if len(steps) else 0.0)
    return out


def uniform_sequence(n: int) -> FloatArray:
    """Return n numbers evenly distributed over -0.5 to 0.5 (golden ratio sequence)."""
    return np.asarray((GOLDEN_RATIO * np.arange(1, n + 1)) % 1.0 - 0.5)


def _accel_noise(m: Messages, index: IntArray, policy: EvidencePolicy) -> FloatArray:
    """Return robust standard deviations of a_x and a_y between messages, at least ``level``."""
    steps = np.diff(np.stack([m.accel_x[index], m.accel_y[index]]), axis=1)
    if steps.shape[1] < MIN_READINGS or not np.isfinite(steps).all():
        return np.full(2, policy.min_level_std)
    # the difference of two readings has sqrt(2) times the noise of one
    size = MAD_TO_SIGMA / np.sqrt(2.0) * np.median(np.abs(steps), axis=1)
    return np.asarray(np.maximum(size, policy.min_level_std))
