"""When a command came, or a gyro was read, is known to a part of a tenth of a second only."""

from __future__ import annotations

import numpy as np
import pytest
from campaign import run
from campaign_cases import cases

from dart_hal.diagnose import search, space
from dart_hal.diagnose.drive import STEP, _blurred


@pytest.fixture(scope="module")
def whenever():
    """Laps in which nothing is hidden; commands change twice as often as they are logged."""
    return next(c for c in cases(["null"]) if c.seed == 62)


def named(case):
    return [c["effect"] for c in run(case)["causes"]]


def test_commands_between_messages_are_no_lag(whenever):
    assert named(whenever) == []


def test_with_all_commands_of_one_age_there_would_be_a_lag(whenever, monkeypatch):
    for module in (space, search):
        monkeypatch.setattr(module, "widest", lambda ahead: 0.0)
    monkeypatch.setattr(search, "AGES", tuple((a, 0.0) for a, _ in search.AGES))
    assert "steering_lag" in named(whenever)


def test_a_step_that_comes_any_time_is_a_ramp_in_the_mean():
    step = np.repeat([0.0, 1.0], 50)
    ramp = _blurred(step, 0.05 / STEP)
    assert ramp[[44, 55]] == pytest.approx([0.0, 1.0])
    assert np.diff(ramp[45:55]) == pytest.approx(0.1)
    assert ramp.sum() == pytest.approx(step.sum())
