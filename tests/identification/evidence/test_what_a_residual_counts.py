"""Sizes of residuals where commands come at any time, and of sensors without noise."""

from __future__ import annotations

import numpy as np
import pytest

from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.residuals import Residuals

WINDOWS = 400
COLUMNS = 6
AGES = 0.025
MOVED = slice(0, 2)
"""Columns that a command moves, in every fourth window."""


@pytest.fixture
def whenever():
    """(residuals, by how much the age of a command moves them [1/s])."""
    rng = np.random.default_rng(1)
    older = np.zeros((WINDOWS, COLUMNS))
    older[::4, MOVED] = 8.0
    age = rng.uniform(-1.0, 1.0, (WINDOWS, 1)) * AGES * np.sqrt(3.0)
    motion = 0.01 * rng.normal(size=(WINDOWS, COLUMNS)) + older * age
    return Residuals(motion, rng.normal(size=(WINDOWS, 4))), older


def whiten_residuals(residuals, older):
    blocks = np.arange(WINDOWS), np.arange(WINDOWS)
    return estimate_noise(residuals, blocks, sensitivity=older).whiten(residuals)[0]


def test_ages_of_commands_are_measured_by_what_they_move(whenever):
    residuals, older = whenever
    blocks = np.arange(WINDOWS), np.arange(WINDOWS)
    certain = estimate_noise(residuals, blocks, sensitivity=older).age_scale
    assert (certain[older == 0.0] == 1.0).all()
    assert certain[older > 0.0] == pytest.approx(0.01 / (8.0 * AGES), rel=0.2)


def test_what_an_age_moves_is_no_larger_than_the_rest(whenever):
    residuals, older = whenever
    moved = whiten_residuals(residuals, older)[::4, MOVED]
    assert np.std(moved) == pytest.approx(1.0, rel=0.25)
    whitened = whiten_residuals(residuals, None)[::4, MOVED]
    assert np.std(whitened) > 3.0, "by the sizes of columns alone"


def test_where_all_commands_have_one_age_nothing_counts_less(whenever):
    residuals, older = whenever
    rng = np.random.default_rng(2)
    quiet = Residuals(0.01 * rng.normal(size=residuals.motion.shape) + 0.003 * older,
                      residuals.sensors)
    blocks = np.arange(WINDOWS), np.arange(WINDOWS)
    certain = estimate_noise(quiet, blocks, sensitivity=older).age_scale
    assert (certain == 1.0).all(), "one age for all is what a fit finds"


def test_no_sensor_is_known_better_than_it_counts():
    """One without noise is off by half a step at most, in every reading the same."""
    rng = np.random.default_rng(3)
    blocks = (np.arange(WINDOWS), np.arange(WINDOWS))
    motion = np.zeros((0, 1))
    still = estimate_noise(Residuals(motion, np.full((WINDOWS, 4), 1e-4)),
                           (blocks[0][:0], blocks[1]))
    step = np.array([np.radians(1.0 / 16.0), 0.01, 0.01])
    assert still.sensors[1:] == pytest.approx(step / np.sqrt(12.0), rel=0.02)
    noisy = estimate_noise(Residuals(motion, 0.1 * rng.normal(size=(WINDOWS, 4))),
                   (blocks[0][:0], blocks[1]))
    assert noisy.sensors == pytest.approx(0.1, rel=0.2)
