"""The errors of real parts that the coverage campaign draws."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.calibration.clock import HOST_CRYSTAL_STD as STATED
from dart_lab.sim import mock_imu
from dart_lab.sim.mock_imu import MockImu
from studies.calibration.hidden_errors import true_sensors, url_of
from studies.calibration.real_parts import (
    CRYSTAL,
    filtered_gyro,
    host_second,
    in_seconds,
    rear_bend,
)

CARS = range(1, 401)


def test_a_longer_second_makes_pulses_longer_and_clocks_slower():
    two = np.array([2.0])
    assert in_seconds("throttle.neutral_us", two, 1.5) == pytest.approx(3.0)
    assert in_seconds("latency.pulse_to_yaw", two, 1.5) == pytest.approx(3.0)
    assert in_seconds("pwm.oscillator_hz", two, 2.0) == pytest.approx(1.0)
    assert in_seconds("imu.gyro_bias", two, 2.0) == pytest.approx(1.0)
    assert in_seconds("imu.gyro_scale", two, 1.5) == pytest.approx(3.0)
    for name in ("steering.slew_us_s", "mocap.marker_x", "lidar.scale"):
        assert in_seconds(name, two, 1.5) == pytest.approx(2.0)


def test_crystals_are_within_their_data_sheet_and_no_better_than_stated():
    errors = np.array([host_second(seed) - 1.0 for seed in CARS])
    assert np.max(np.abs(errors)) < sum(CRYSTAL)
    assert 0.7 * STATED < np.std(errors) < STATED


def test_rear_tyres_end_near_their_load():
    ends = np.array([1.0 / rear_bend(seed) for seed in CARS])
    assert np.min(ends) > 5.0
    assert np.max(ends) < 8.5
    assert "rear_saturation" in url_of(5, late=False, bent=True)
    assert true_sensors(url_of(5, late=False, bent=True)) == true_sensors(url_of(5, late=False))


def delay() -> float:
    """Mean delay [s] of a ramp in the gyro's samples, less half a sample."""
    imu, dt, rate = MockImu(), 1e-3, 2.0
    for k in range(1000):
        imu.set(k * dt, (0.0, 0.0, rate * k * dt), (0.0, 0.0, 0.0))
    found = imu.sample(1.0)
    assert found is not None
    return 0.99 - found[5] / 900.0 / rate


def test_the_filter_of_a_seed_delays_and_is_taken_off_again():
    usual, hertz = delay(), mock_imu.GYRO_HZ
    delays = []
    for seed in range(1, 6):
        with filtered_gyro(seed):
            assert hertz != mock_imu.GYRO_HZ
            delays.append(delay())
    assert hertz == mock_imu.GYRO_HZ
    assert delay() == usual
    assert 2e-4 < np.std(delays) < 1.2e-3


def test_the_filter_is_taken_off_after_an_error_too():
    hertz = mock_imu.GYRO_HZ
    with pytest.raises(ZeroDivisionError), filtered_gyro(3):
        raise ZeroDivisionError
    assert hertz == mock_imu.GYRO_HZ
