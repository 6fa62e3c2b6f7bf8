"""Log samples of the sensors in their own axes, together with the State computed from them.

Mounting, scale and bias of the car's files are applied to the State but not to the sample. So a
second calibration does not measure the result of the first.
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
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import STATE
from dart_hal.wire.plausible import Gates

# Pairs below which a log counts as empty.
MIN_LOGGED_PAIRS = 50


@dataclass(frozen=True, slots=True)
class ImuSamples:
    """One row per new sample of the IMU.

    t (n,) [s] of the car's clock; gyro (n, 3) [rad/s] and acc (n, 3) [m/s2] in sensor axes; speed
    (n,) [m/s] of the wheels.
    """

    t: FloatArray
    gyro: FloatArray
    acc: FloatArray
    speed: FloatArray

    @property
    def rotation(self) -> FloatArray:
        """Integral of the gyro from the first to the last row, shape (3,) [rad]."""
        steps = np.diff(self.t)[:, None]
        return np.asarray((0.5 * (self.gyro[1:] + self.gyro[:-1]) * steps).sum(axis=0))

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])


class SensorLog:
    """Collect pairs of sample and State of one car from now on."""

    def __init__(self, car: Car) -> None:
        self._decoder = FrameDecoder(UP, Gates())
        self._reader = FrameReader()
        self._waiting: deque[Sample] = deque(maxlen=64)
        self._pairs: list[tuple[Sample, State]] = []
        car.on_bytes(self._bytes)
        car.on_state(self._state)

    def pairs(self) -> list[tuple[Sample, State]]:
        """Return the pairs since the last call."""
        pairs = self._pairs
        self._pairs = []
        return pairs

    def take(self) -> ImuSamples | None:
        """Return the samples since the last call; None for fewer than ``MIN_LOGGED_PAIRS``."""
        rows = []
        last = -np.inf
        for sample, state in self.pairs():
            if sample.gyro is None or sample.acc is None or sample.imu_t <= last:
                continue
            last = sample.imu_t
            # The device's clock is off by less than a per cent, of an age of 10 ms.
            rows.append((state.t - sample.imu_age, *sample.gyro, *sample.acc, state.speed))
        if len(rows) < MIN_LOGGED_PAIRS:
            return None
        table = np.array(rows)
        return ImuSamples(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7])

    def device_rate(self) -> float:
        """Seconds of the car's clock per second of the Nano's clock since the last ``take``.

        Slope of the line through all pairs. Raises CalibrationFailed for too few pairs.
        """
        if len(self._pairs) < MIN_LOGGED_PAIRS:
            raise CalibrationFailed("too little telemetry", found=f"{len(self._pairs)} frames",
                                    expected=f"at least {MIN_LOGGED_PAIRS} (100 per second)",
                                    remedy="dart-hal doctor")
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
