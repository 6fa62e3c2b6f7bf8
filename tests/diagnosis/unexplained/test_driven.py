"""Noise is what does not go with the driving."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.unexplained.driven import remove_driven_motion
from dart_lab.diagnosis.unexplained.features import window_features
from dart_lab.identification.evidence.onboard_drive import MESSAGES_AHEAD
from tests.diagnosis.onboard_files import evidence, record_onboard

GYRO_COLUMNS = slice(1, None, 2)


@pytest.fixture(scope="module")
def plain_evidence(tmp_path_factory):
    return evidence(record_onboard(tmp_path_factory.mktemp("plain"), seed=21))


def spread(motion):
    return np.median(np.abs(motion - np.median(motion, axis=0)), axis=0)


@pytest.mark.slow
def test_an_error_that_goes_with_the_turn_is_no_noise_and_noise_is(plain_evidence):
    rng = np.random.default_rng(3)
    n = len(plain_evidence.motion_drive)
    noise = 0.01 * rng.normal(size=(n, 2 * MESSAGES_AHEAD))
    r = replace(plain_evidence.residuals(PAPER), motion=noise)
    alone = remove_driven_motion(plain_evidence, PAPER, r).motion
    assert np.median(spread(alone) / spread(noise)) == pytest.approx(1.0, abs=0.1)
    wrong = 0.05 * np.tanh(3.0 * window_features(plain_evidence, PAPER, 50)["steering_angle"])
    both = noise.copy()
    both[:, GYRO_COLUMNS] += wrong[:, None]
    left = remove_driven_motion(plain_evidence, PAPER, replace(r, motion=both)).motion
    assert np.median(spread(both)[GYRO_COLUMNS]) > 2.0 * np.median(spread(noise)[GYRO_COLUMNS])
    assert np.median(spread(left)[GYRO_COLUMNS]) < 1.4 * np.median(spread(noise)[GYRO_COLUMNS])
