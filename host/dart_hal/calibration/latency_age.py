"""How old the gyro's samples are when they are read.

The BNO055 makes a sample each 10 ms by its clock, the Nano reads one each 10 ms by its own. As one
clock gains on the other, the age of what is read runs through 0 to 10 ms like a saw, one tooth in
2 s where the clocks differ by 0.5 %, in a minute where they differ by 0.02 %. So the mean over
some turns is no 5 ms, but what single turns show tells which saw it is:

    own_i = delay + mean age over turn i + e_i

Every saw is weighed by how well it fits (e_i normal, of unknown size: p ~ rss^(-(n - 1) / 2)).
Where no tooth ends within the turns, many fit, and the interval is wide.
"""

from __future__ import annotations

import math

import numpy as np

from dart_hal.types import FloatArray

from .latency_log import Traffic

PERIOD, DRIFT = 0.010, 0.01
"""s of the BNO055's samples; the share by which its oscillator and the Nano's resonator (0.5 %)
may differ."""
FINEST, PHASES = 0.05, 100
"""Of a tooth by which saws differ that are tried, at the end of the turns; begins of a tooth."""
TURNING = (0.03, 0.15)
"""s after a pulse in which the yaw rate follows it."""
LEAST = 0.2e-3
"""s, one sigma of a single turn's delay at best."""
WORK, WORK_STD = 0.8e-3, 0.3e-3
"""s of a slot of the firmware beside the IMU, by its emulator, and one sigma."""
LAST_BYTE = 0.8
"""Of the time that the IMU takes: 18 of 22 bytes where a status is read after the sample, 12 of 16
by the shorter plan. The yaw rate is the last of a sample."""
READ = (2.0e-3, 0.9e-3)
"""s from the begin of the read to the yaw rate, and one sigma, where the Nano does not say: 18
bytes of 22.5 us, each stretched by 0 to 180 us."""
QUICKEST = 18 * 22.5e-6
"""s of those bytes without stretching."""


def read_after(traffic: Traffic) -> tuple[float, float]:
    """(s from the begin of a read of the IMU to the yaw rate, one sigma)."""
    if math.isnan(traffic.slot):
        return READ
    return max(LAST_BYTE * (traffic.slot - WORK), QUICKEST), WORK_STD


def without_age(own: FloatArray, at: FloatArray) -> tuple[float, float]:
    """(delay, one sigma) [s] of turns (n,) that seemed late by ``own`` [s], of pulses at ``at``.

    Turns that lie farther from the others than any age were in another PWM frame, and left out.
    """
    same = np.abs(own - np.median(own)) < PERIOD
    own, at = own[same], at[same]
    n, span = len(own), float(np.ptp(at))
    count = round(2.0 * DRIFT * span / PERIOD / FINEST)
    drift = (np.arange(count)[:, None, None] - 0.5 * count + 0.25) * FINEST / span
    begins = np.arange(PHASES)[None, :, None] / PHASES
    since = at - at[0]
    low, high = (begins + drift * (since + own + end) for end in TURNING)
    late = own - PERIOD * (_area(high) - _area(low)) / (high - low)
    delay = late.mean(axis=-1)
    left = np.sum((late - delay[..., None])**2, axis=-1) + n * LEAST**2
    log = -0.5 * (n - 1) * np.log(left)
    share = np.exp(log - log.max())
    share /= share.sum()
    mean = float(np.sum(share * delay))
    return mean, float(np.sqrt(np.sum(share * ((delay - mean) ** 2 + left / (n - 1) / n))))


def _area(x: FloatArray) -> FloatArray:
    """Integral from 0 to x of a saw of period and height 1."""
    whole = np.floor(x)
    return np.asarray(0.5 * (whole + (x - whole) ** 2))
