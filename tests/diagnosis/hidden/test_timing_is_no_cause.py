"""When a command came, or a gyro was read, is known to a part of a tenth of a second only."""

from __future__ import annotations

import pytest

from dart_lab.diagnosis import conclude
from dart_lab.diagnosis.search import forward as search
from dart_lab.identification.evidence import ages, space
from studies.diagnosis.campaign import run
from studies.diagnosis.campaign_cases import cases


@pytest.fixture(scope="module")
def whenever():
    """Laps in which nothing is hidden; commands change twice as often as they are logged."""
    return next(c for c in cases(["null"]) if c.seed == 62)


def search_causes(case):
    """Names that the search arrived at, those that no other recording bears out included."""
    result = run(case)
    return [c["effect"] for c in (*result["causes"], *result["possible"])]


@pytest.mark.slow
def test_commands_between_messages_are_no_lag(whenever):
    assert search_causes(whenever) == []


@pytest.mark.slow
def test_with_all_commands_of_one_age_there_would_be_a_lag(whenever, monkeypatch):
    for module in (space, ages):
        monkeypatch.setattr(module, "max_age_spread", lambda ahead: 0.0)
    ages_without_spread = tuple((a, 0.0) for a, _ in search.START_AGES)
    monkeypatch.setattr(search, "START_AGES", ages_without_spread)
    assert "steering_lag" in search_causes(whenever)


@pytest.mark.slow
@pytest.mark.parametrize("aged", [True, False])
@pytest.mark.long_except("True")
def test_a_lag_with_a_fixed_model_gains_at_the_age_of_the_commands(aged, monkeypatch):
    """Control: with the age of the commands on top of its delays, the lag seems to raise the errors
    of the test recording."""
    if not aged:
        monkeypatch.setattr(conclude, "vehicles_for_logs",
                            lambda q, timings, point: (point.vehicle, point.vehicle))
    (cause,) = run(next(c for c in cases(["fixed"], ["throttle_lag"], 1500)))["causes"]
    assert cause["effect"] == "throttle_lag"
    assert (cause["gain"]["test"] > 0.0) == aged
    assert cause["cost"]["ci90"][0] > 1.0


@pytest.mark.slow
def test_a_few_wild_windows_do_not_outweigh_the_gain_of_a_certain_cause():
    """Steps of random length: a car that slides now and then, and 0.5 degrees of trim. The root
    mean square of the yaw angle leaves open that it may be nothing; the loss of all errors does
    not."""
    (cause,) = run(next(c for c in cases(["fixed"], ["steering_trim"], 1500)))["causes"]
    assert cause["effect"] == "steering_trim"
    assert cause["gain"]["test_ci95"][0] < 0.0
    assert cause["cost"]["ci90"][0] > 1.0
