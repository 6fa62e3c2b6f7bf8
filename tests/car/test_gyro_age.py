"""The age of the yaw rate that a State reports, against the update that the IMU made."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation import imu_clock
from dart_lab.sim.hidden import hidden_car

UPDATES = 0.010
"""s between two updates of a simulated IMU; they begin with the world's clock."""
READ_PERIOD = 2.5e-3
"""Relative error of the Nano's clock from which the age passes through all its values in 4 s."""
SEED = next(k for k in range(1, 60) if abs(hidden_car(k).clock_error) > READ_PERIOD)


def age_errors(nano: str, seconds: float) -> np.ndarray:
    """Errors [s] of ``imu_age`` once the beat of the clocks is known."""
    with Car.over(open_backend(f"sim://?seed={SEED}{nano}")) as car:
        states = list(car.states(duration=seconds))[-200:]
    updated = np.array([s.t - s.health.imu_age for s in states])
    return np.remainder(updated + 0.5 * UPDATES, UPDATES) - 0.5 * UPDATES


@pytest.mark.slow
def test_the_age_of_the_yaw_rate_is_that_of_its_update():
    errors = age_errors("&nano=mock", 9.0)
    assert abs(np.mean(errors)) < 0.6e-3
    assert np.max(np.abs(errors)) < 1.5e-3


@pytest.mark.slow
def test_control_the_begin_of_the_read_is_not_when_the_gyro_is_read(monkeypatch):
    monkeypatch.setattr(imu_clock, "GYRO_READ_SHARE", 0.0)
    monkeypatch.setattr(imu_clock, "MIN_GYRO_READ_TIME", 0.0)
    assert abs(np.mean(age_errors("&nano=mock", 9.0))) > 1.5e-3


@pytest.mark.parametrize(("slot", "delay"), [(5.268e-3, 2.44e-3),
                                             (0.0, imu_clock.MIN_GYRO_READ_TIME),
                                             (float("nan"), imu_clock.DEFAULT_GYRO_READ[0])])
def test_the_read_of_the_gyro_begins_after_the_acceleration(slot, delay):
    assert imu_clock.gyro_read_delay(slot)[0] == pytest.approx(delay, abs=0.02e-3)
