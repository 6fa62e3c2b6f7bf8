"""A BNO055 for MockNano: low-pass filters, samples at 100 Hz, raw integers."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from random import Random

# Bandwidths of the sensor's low-pass filters [Hz].
GYRO_HZ = 32.0
ACCEL_HZ = 62.5
SAMPLE_PERIOD = 0.010
# Time from power-on to the first sample [s]: boot 0.40, mode change and first read.
IMU_START = 0.46


class MockImu:
    """Filters the true values, samples them every 10 ms and quantises them."""

    def __init__(self) -> None:
        self.fault = "ok"
        self.value = 1.0
        self._contact = Random(0)
        self._history: deque[tuple[int, ...]] = deque(maxlen=128)
        self._gyro = [0.0, 0.0, 0.0]
        self._accel = [0.0, 0.0, 0.0]
        self._inputs: tuple[Sequence[float], Sequence[float]] = ((0.0,) * 3, (0.0,) * 3)
        self._t = 0.0
        self._dt = 0.0
        self._gyro_gain = self._accel_gain = 0.0
        self._slot = 0
        self._samples: deque[tuple[float, tuple[int, ...]]] = deque(maxlen=4)

    def set(self, t: float, gyro: Sequence[float], lin_acc: Sequence[float]) -> None:
        """Set the true values from t on (sensor axes, SI); those of the last call hold until t."""
        dt = t - self._t
        self._t = t
        before = self._inputs
        self._inputs = (gyro, lin_acc)
        gyro, lin_acc = before
        if dt != self._dt:
            self._dt = dt
            self._gyro_gain = 1.0 - math.exp(-2.0 * math.pi * GYRO_HZ * dt)
            self._accel_gain = 1.0 - math.exp(-2.0 * math.pi * ACCEL_HZ * dt)
        # First-order low-pass with the inputs that held since the last call.
        g = self._gyro_gain
        a = self._accel_gain
        w = self._gyro
        f = self._accel
        w[0] += g * (gyro[0] - w[0])
        w[1] += g * (gyro[1] - w[1])
        w[2] += g * (gyro[2] - w[2])
        f[0] += a * (lin_acc[0] - f[0])
        f[1] += a * (lin_acc[1] - f[1])
        f[2] += a * (lin_acc[2] - f[2])
        slot = int(t / SAMPLE_PERIOD + 1e-9)
        if slot != self._slot:
            self._slot = slot
            values = (*(_quantise(v, 100.0) for v in f), *(_quantise(v, 900.0) for v in w))
            self._history.append(values)
            self._samples.append((t, self._apply_fault(values, slot)))

    def _apply_fault(self, values: tuple[int, ...], slot: int) -> tuple[int, ...]:
        """Return the data registers with the present fault."""
        fault = self.fault
        last = self._samples[-1][1] if self._samples else values
        if fault == "garbage":
            return tuple((0x5A5A * (slot + k)) % 0x10000 - 0x8000 for k in range(6))
        if fault == "zero":
            return (0,) * 6
        if fault == "wrong":
            return tuple(_quantise(v, self.value) for v in values)
        if fault == "delayed":
            steps = min(round(self.value / SAMPLE_PERIOD), len(self._history) - 1)
            return self._history[-1 - steps]
        if fault == "slow":
            return last if slot % max(1, round(1.0 / (self.value * SAMPLE_PERIOD))) else values
        return last if fault == "stuck" else values

    def sample(self, t: float) -> tuple[int, ...] | None:
        """Return raw (lin_acc, gyro), as the registers are at t; None = no answer."""
        if self.fault == "off":
            return None
        if self.fault == "intermittent" and self._contact.random() < self.value:
            return None
        found = None
        for when, values in self._samples:
            if when <= t:
                found = values
        return found


def _quantise(value: float, lsb: float) -> int:
    return max(-32768, min(32767, round(value * lsb)))
