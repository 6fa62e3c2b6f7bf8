"""Gyro bias at standstill: a scalar Kalman filter that pauses while the car drives."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

# s at rest before a reading counts: the body still rocks on its springs.
SETTLING_TIME = 0.5
# rad/s per sqrt(s): slow drift of the bias with temperature, 0.4 deg/h/sqrt(h).
BIAS_WALK = 2e-6
# Factor of the variance of a sample: the 32 Hz filter leaves about a quarter of the samples
# independent.
CORRELATION_FACTOR = 4.0
# Standard deviations of the innovation beyond which a reading is rejected.
GYRO_GATE = 5.0
# rad/s per LSB of the BNO055.
GYRO_QUANTUM = 1.0 / 900.0


class GyroBias:
    """Bias of the yaw gyro [rad/s] and its standard deviation, learnt while the car is at rest.

    noise: rad/s per sqrt(Hz). A reading outside the gate (the car is being turned by hand)
    restarts the settling time and is not used.
    """

    def __init__(self, value: float, std: float, noise: float) -> None:
        self.value = value
        self._variance = std * std
        self._noise_density = noise
        self._rest_time = 0.0
        self._learning = False

    @property
    def std(self) -> float:
        """Return the standard deviation of the bias [rad/s]."""
        return sqrt(self._variance)

    def stop_learning(self) -> None:
        """Pause the filter: the car drives."""
        self._rest_time = 0.0
        self._learning = False

    def observe(self, reading: float, dt: float, on_begin: Callable[[float], None]) -> bool:
        """Update the bias with one reading [rad/s] at rest, ``dt`` s after the one before.

        ``on_begin`` gets the standard deviation of the old bias once, before the first
        reading of this standstill changes it. Returns False for a reading outside the gate.
        """
        if dt <= 0.0:
            return True
        sample = self._noise_density**2 / dt + GYRO_QUANTUM * GYRO_QUANTUM / 12.0
        innovation = reading - self.value
        if innovation * innovation > (
                GYRO_GATE * GYRO_GATE * (self._variance + sample) + GYRO_QUANTUM**2):
            self.stop_learning()
            return False
        self._rest_time += dt
        if self._rest_time < SETTLING_TIME:
            return True
        if not self._learning:
            on_begin(self.std)
            self._learning = True
        self._variance += BIAS_WALK * BIAS_WALK * dt
        gain = self._variance / (self._variance + CORRELATION_FACTOR * sample)
        self.value += gain * innovation
        self._variance *= 1.0 - gain
        return True
