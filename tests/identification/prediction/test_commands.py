"""Commands between messages: held, spread in time, read between samples."""

from __future__ import annotations

import numpy as np
import pytest

from dart_lab.identification.prediction.commands import catmull_rom, spread_over, zero_order_hold


def test_a_held_command_is_its_mean_over_every_sample():
    held = zero_order_hold(np.array([0.005, 0.0325]), np.array([0.2, 0.6]), 6)
    assert held == pytest.approx([0.2, 0.2, 0.2, 0.25 * 0.2 + 0.75 * 0.6, 0.6, 0.6])


def test_a_step_that_comes_any_time_is_a_ramp_in_the_mean():
    step = np.repeat([0.0, 1.0], 50)
    ramp = spread_over(step, 0.05)
    assert ramp[[44, 55]] == pytest.approx([0.0, 1.0])
    assert np.diff(ramp[45:55]) == pytest.approx(0.1)
    assert ramp.sum() == pytest.approx(step.sum())
    assert spread_over(step, 0.005) is step, "less than a sample"


def test_between_samples_a_parabola_is_itself():
    at = np.array([3.0, 4.25, 9.9])
    assert catmull_rom(np.arange(20.0) ** 2, at) == pytest.approx(at**2)
