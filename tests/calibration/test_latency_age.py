"""The age of the gyro's samples, taken off the delays of single turns."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.calibration.latency_age import PERIOD, QUICKEST, READ, read_after, without_age
from dart_hal.calibration.latency_log import Traffic

DELAY = 0.02


def turns(rng, drift, n=20):
    """(seeming delays, times of the pulses) of a car whose clocks differ by ``drift``."""
    at = np.cumsum(rng.uniform(0.4, 0.6, n))
    ages = PERIOD * ((rng.uniform() + drift * (at + DELAY + 0.09) / PERIOD) % 1.0)
    return DELAY + ages + rng.normal(0.0, 4e-4, n), at


@pytest.mark.parametrize("drift", [-0.0047, -0.002, 0.001, 0.003])
def test_clocks_that_drift_tell_the_age_to_a_millisecond(drift):
    rng = np.random.default_rng(4)
    found = np.array([without_age(*turns(rng, drift)) for _ in range(12)])
    assert np.all(np.abs(found[:, 0] - DELAY) < 1e-3)
    assert np.all(found[:, 1] < 1e-3)


def test_interval_holds_the_delay_of_any_drift_and_the_plain_mean_does_not():
    """Clocks in step hide the age: the interval is wide then, and the mean of the turns off."""
    rng, z, plain = np.random.default_rng(5), [], []
    for drift in rng.uniform(-3e-4, 3e-4, 30):
        own, at = turns(rng, drift)
        delay, std = without_age(own, at)
        z.append((delay - DELAY) / std)
        plain.append((own.mean() - 0.5 * PERIOD - DELAY) / (np.std(own) / np.sqrt(len(own))))
    assert np.mean(np.abs(z) < 1.645) > 0.8
    assert np.mean(np.abs(plain) < 1.645) < 0.5


def test_a_turn_of_another_pwm_frame_is_left_out():
    own, at = turns(np.random.default_rng(6), 0.002)
    own[3] += 0.02
    assert without_age(own, at)[0] == pytest.approx(DELAY, abs=1e-3)


@pytest.mark.parametrize(("slot", "seconds"), [
    (np.nan, READ[0]), (5.25e-3, 18 * 202.5e-6), (1e-3, QUICKEST)])
def test_the_firmware_tells_how_long_a_read_takes(slot, seconds):
    """180 us of stretching of each of 18 bytes, as the emulated chip has them, or none."""
    nothing = np.zeros((0, 0))
    assert read_after(Traffic(nothing, nothing, slot))[0] == pytest.approx(seconds, abs=2e-4)
