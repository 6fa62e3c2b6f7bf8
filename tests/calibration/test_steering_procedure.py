"""The procedure on a bench car: truth inside its intervals, and a reason when it fails."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.calibration.steering import calibrate_steering


@pytest.fixture(scope="module")
def nothing():
    return None


def test_finds_map_backlash_and_slip_of_hidden_cars(drawn):
    inside, rms, backlash = [], [], []
    for seed in range(20):
        car = drawn(seed)
        result = calibrate_steering(car, dry_run=True)
        error = result.angle - car.true_angle(result.command)
        inside += list(np.abs(error) < 1.645 * result.angle_std)
        rms.append(np.degrees(np.sqrt(np.mean(error**2))))
        backlash.append((result.backlash.value - car.backlash) / result.backlash.std)
    print(np.mean(inside), np.round(rms, 3), np.round(backlash, 1))
    assert 0.80 <= np.mean(inside) <= 0.98
    assert max(rms) <= 0.4
    assert np.mean(np.abs(backlash) < 1.645) >= 0.7
