"""A BNO055 as MockNano sees it: low-pass, 100 Hz samples, raw integers."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from random import Random

GYRO_HZ, ACCEL_HZ = 32.0, 62.5
PERIOD = 0.010
START = 0.46
"""s from power to the first sample: boot 0.40, mode change and first read."""


class MockImu:
    """Filters the true values, samples them each 10 ms, quantises."""

    def __init__(self) -> None:
        self.fault, self.value = "ok", 1.0
        self._contact = Random(0)
        self._history: deque[tuple[int, ...]] = deque(maxlen=128)
        self._gyro = [0.0, 0.0, 0.0]
        self._accel = [0.0, 0.0, 0.0]
        self._shows: tuple[Sequence[float], Sequence[float]] = ((0.0,) * 3, (0.0,) * 3)
        self._t = 0.0
        self._dt = 0.0
        self._g = self._a = 0.0
        self._k = 0
        self._samples: deque[tuple[float, tuple[int, ...]]] = deque(maxlen=4)

    def set(self, t: float, gyro: Sequence[float], lin_acc: Sequence[float]) -> None:
        """True values from t on (sensor axes, SI); until t those of the last call."""
        dt = t - self._t
        self._t = t
        before, self._shows = self._shows, (gyro, lin_acc)
        gyro, lin_acc = before
        if dt != self._dt:
            self._dt = dt
            self._g = 1.0 - math.exp(-2.0 * math.pi * GYRO_HZ * dt)
            self._a = 1.0 - math.exp(-2.0 * math.pi * ACCEL_HZ * dt)
        g, a, w, f = self._g, self._a, self._gyro, self._accel
        w[0] += g * (gyro[0] - w[0])
        w[1] += g * (gyro[1] - w[1])
        w[2] += g * (gyro[2] - w[2])
        f[0] += a * (lin_acc[0] - f[0])
        f[1] += a * (lin_acc[1] - f[1])
        f[2] += a * (lin_acc[2] - f[2])
        slot = int(t / PERIOD + 1e-9)
        if slot != self._k:
            self._k = slot
            values = (*(_raw(v, 100.0) for v in f), *(_raw(v, 900.0) for v in w))
            self._history.append(values)
            self._samples.append((t, self._shown(values, slot)))

    def _shown(self, values: tuple[int, ...], slot: int) -> tuple[int, ...]:
        """The data registers, as the fault has them."""
        fault, last = self.fault, self._samples[-1][1] if self._samples else values
        if fault == "garbage":
            return tuple((0x5A5A * (slot + k)) % 0x10000 - 0x8000 for k in range(6))
        if fault == "zero":
            return (0,) * 6
        if fault == "wrong":
            return tuple(_raw(v, self.value) for v in values)
        if fault == "delayed":
            return self._history[-1 - min(round(self.value / PERIOD), len(self._history) - 1)]
        if fault == "slow":
            return last if slot % max(1, round(1.0 / (self.value * PERIOD))) else values
        return last if fault == "stuck" else values

    def sample(self, t: float) -> tuple[int, ...] | None:
        """(lin_acc, gyro) raw, as registers read at t; None = no answer."""
        if self.fault == "off":
            return None
        if self.fault == "intermittent" and self._contact.random() < self.value:
            return None
        found = None
        for when, values in self._samples:
            if when <= t:
                found = values
        return found


def _raw(value: float, lsb: float) -> int:
    return max(-32768, min(32767, round(value * lsb)))
