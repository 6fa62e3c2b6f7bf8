"""What the sensors say in their own axes, beside the State that was made of it.

Mounting, scale and bias that a car's files already hold are in the State and
not in the sample, so that a second calibration does not measure the first.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import FloatArray, State
from dart_hal.estimation.frames import FrameReader, Sample
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import Decoder
from dart_hal.wire.messages import STATE
from dart_hal.wire.plausible import Gates

FEW = 50
"""Pairs below which nothing can be said."""


@dataclass(frozen=True, slots=True)
class Sensed:
    """Time [s] of the car's clock, gyro (n, 3) [rad/s], acc (n, 3) [m/s2], both in sensor
    axes, speed [m/s] of the wheels; one row per new sample of the IMU."""

    t: FloatArray
    gyro: FloatArray
    acc: FloatArray
    speed: FloatArray

    @property
    def turned(self) -> FloatArray:
        """Integral of the gyro from the first to the last row, shape (3,) [rad]."""
        steps = np.diff(self.t)[:, None]
        return np.asarray((0.5 * (self.gyro[1:] + self.gyro[:-1]) * steps).sum(axis=0))

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])


class SensorLog:
    """Collects pairs of sample and State of one car from now on."""

    def __init__(self, car: Car) -> None:
        self._decoder, self._reader = Decoder(UP, Gates()), FrameReader()
        self._waiting: deque[Sample] = deque(maxlen=64)
        self._pairs: list[tuple[Sample, State]] = []
        car.on_bytes(self._bytes)
        car.on_state(self._state)

    def pairs(self) -> list[tuple[Sample, State]]:
        """What came since the last call, as it came."""
        pairs, self._pairs = self._pairs, []
        return pairs

    def take(self) -> Sensed | None:
        """What came since the last call; None if it is next to nothing."""
        rows = []
        last = -np.inf
        for sample, state in self.pairs():
            if sample.gyro is None or sample.acc is None or sample.imu_t <= last:
                continue
            last = sample.imu_t
            # the device's clock is off by less than a percent, of an age of 10 ms
            rows.append((state.t - sample.imu_age, *sample.gyro, *sample.acc, state.speed))
        if len(rows) < FEW:
            return None
        table = np.array(rows)
        return Sensed(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7])

    def device_rate(self) -> float:
        """Seconds of the car's clock per second of the Nano's since the last ``take``.

        A line through all pairs. Errors: CalibrationFailed if there are next to none.
        """
        if len(self._pairs) < FEW:
            raise CalibrationFailed("no telemetry", found=f"{len(self._pairs)} frames",
                                    expected="100 per second", remedy="dart-hal doctor")
        device = np.array([sample.t_dev for sample, _ in self._pairs])
        host = np.array([state.t for _, state in self._pairs])
        device -= device.mean()
        return float(device @ host / (device @ device))

    def _bytes(self, direction: str, data: bytes, t: float) -> bytes:
        if direction == "rx":
            self._waiting.extend(self._reader.read(frame.values(), t)
                                 for frame in self._decoder.feed(data) if frame.message is STATE)
        return data

    def _state(self, state: State) -> None:
        if self._waiting:
            self._pairs.append((self._waiting.popleft(), state))
