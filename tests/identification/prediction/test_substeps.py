"""A step of a command stays a step between samples."""

from __future__ import annotations

import numpy as np
import pytest

from dart_lab.identification.prediction.substeps import SUBSTEPS, average_substeps, quarters


def stepped(t_step, n=40):
    """Means over samples of a step from -1 to 2 at a time in samples."""
    return -1.0 + 3.0 * np.clip(np.arange(n) + 1.0 - t_step, 0.0, 1.0)


def test_means_are_kept_at_any_phase():
    rng = np.random.default_rng(0)
    series = np.repeat(rng.uniform(-1.0, 1.0, 12), 5)
    t_step = np.arange(20)[:, None] + np.array([10.0, 10.25, 13.7])
    got = average_substeps(series, t_step)
    assert got.shape == (20 * SUBSTEPS, 3)
    whole = got.reshape(20, SUBSTEPS, 3).mean(axis=1)
    assert whole[:, 0] == pytest.approx(series[10:30], abs=1e-12)
    total = np.concatenate([[0.0], np.cumsum(series)])
    exact = np.diff(np.interp(np.arange(21) + 13.7, np.arange(len(total)), total))
    steps = np.abs(np.diff(series))
    assert np.abs(whole[:, 2] - exact).max() < 1e-12 + steps.max() * 1e-9


@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.75])
def test_a_step_within_a_sample_takes_no_time(phase):
    series = stepped(20.0 + phase)
    got = average_substeps(series, (np.arange(30) + 5.0)[:, None])[:, 0]
    assert set(np.round(got, 9)) == {-1.0, 2.0}
    assert np.argmax(got > 0.0) == (15.0 + phase) * SUBSTEPS
    # the means of whole samples, held, would spread it over one
    assert len(set(np.round(series, 9))) == (2 if phase == 0.0 else 3)


def test_ends_are_held():
    got = average_substeps(np.array([1.0, 1.0, 3.0]), np.array([[-5.0], [-4.0], [7.0]]))
    assert got[:SUBSTEPS, 0] == pytest.approx(1.0)
    assert got[-SUBSTEPS:, 0] == pytest.approx(3.0)


def test_quarters_of_samples_are_stretches_that_begin_with_them():
    series = np.concatenate([stepped(20.3), np.sin(np.arange(40.0)), np.full(5, 0.7)])
    expected = average_substeps(series, np.arange(float(len(series)))[:, None])
    assert quarters(series).ravel() == pytest.approx(expected[:, 0], abs=1e-12)
