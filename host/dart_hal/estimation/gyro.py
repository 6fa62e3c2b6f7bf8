"""Gyro bias from standstill: a scalar Kalman filter that rests while driving."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

SETTLE = 0.5
"""s of standing before a reading counts: the body still rocks on its springs."""
WALK = 2e-6
"""rad/s per sqrt(s): slow drift of the bias with temperature, 0.4 deg/h/sqrt(h)."""
CORRELATED = 4.0
"""The 32 Hz filter leaves about a quarter of the samples independent."""
GATE = 5.0
QUANTUM = 1.0 / 900.0
"""rad/s per LSB of the BNO055."""


class GyroBias:
    """Bias of the yaw gyro [rad/s], its one sigma, learnt while the car stands.

    noise: rad/s per sqrt(Hz). A reading outside the gate (somebody carries the
    car) restarts the settling time and teaches nothing.
    """

    def __init__(self, value: float, std: float, noise: float) -> None:
        self.value = value
        self._variance = std * std
        self._noise_density = noise
        self._stood = 0.0
        self._learning = False

    @property
    def std(self) -> float:
        return sqrt(self._variance)

    def moving(self) -> None:
        """The car drives: nothing is learnt."""
        self._stood = 0.0
        self._learning = False

    def observe(self, reading: float, dt: float, on_begin: Callable[[float], None]) -> None:
        """One reading [rad/s] of a standing car, ``dt`` s after the one before.

        ``on_begin`` gets the deviation of the old bias once, before the first
        reading of this standstill changes it.
        """
        if dt <= 0.0:
            return
        sample = self._noise_density**2 / dt + QUANTUM * QUANTUM / 12.0
        innovation = reading - self.value
        if innovation * innovation > GATE * GATE * (self._variance + sample) + QUANTUM**2:
            self.moving()
            return
        self._stood += dt
        if self._stood < SETTLE:
            return
        if not self._learning:
            on_begin(self.std)
            self._learning = True
        self._variance += WALK * WALK * dt
        gain = self._variance / (self._variance + CORRELATED * sample)
        self.value += gain * innovation
        self._variance *= 1.0 - gain
