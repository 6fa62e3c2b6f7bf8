"""A car with a VESC, recorded by another laboratory: the speed loop predicts another drive."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle.load import find_model
from dart_lab.identification.evaluation import evaluate
from studies.identification import speed_loop_figures as study


@pytest.fixture(scope="module")
def columns(other_cars):
    return study.read_pair(other_cars / "f1tenth_upenn2022")


@pytest.fixture(scope="module")
def base(other_cars):
    return find_model(other_cars / "f1tenth_upenn2022" / "base.toml")[0]


@pytest.mark.slow
def test_scale_and_limit_follow_from_steady_driving(columns):
    slow, fast = columns
    assert study.find_scale(fast) == pytest.approx(5.0, abs=0.3)
    assert study.find_limit(slow) == pytest.approx(1.3, abs=0.03)
    commands, speeds = study.steady_driving(slow)
    assert np.ptp(commands[commands > 0.4]) > 0.3, "the limit holds at all of these commands"
    assert np.ptp(np.percentile(speeds[commands > 0.4], [10, 90])) < 0.05


@pytest.mark.slow
def test_fitted_speed_loop_predicts_the_other_drive_better_than_the_duty_form(columns, base):
    slow, fast = study.speed_pair(*columns)
    loop, found = study.fit(slow, base)
    assert found.fits["motor"].converged
    error, constant_velocity = study.speed_error(evaluate(loop, [fast], limit=False))
    duty, _ = study.fit(columns[0], base)
    of_duty, _ = study.speed_error(evaluate(duty, [columns[1]], limit=False))
    assert error < 0.8 * constant_velocity
    assert error < 0.9 * of_duty
