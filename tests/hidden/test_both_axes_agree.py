"""An effect of a sensor with two axes has one size, and what smoothing leaves of a turn has two."""

from __future__ import annotations

import pytest
from campaign import run
from campaign_cases import cases

from dart_hal.diagnose import selection


@pytest.fixture(scope="module")
def waves():
    """A drive in which nothing is hidden, commands in step with the messages."""
    return next(c for c in cases(["null"]) if c.seed == 77)


def named(case):
    return [c["effect"] for c in run(case)["causes"]]


def test_what_smoothing_leaves_of_a_turn_is_no_lever_arm(waves):
    assert named(waves) == []


def test_without_asking_both_axes_it_would_be_one(waves, monkeypatch):
    monkeypatch.setattr(selection, "AT_ODDS", 1e9)
    assert named(waves) == ["imu_lever_arm"]
