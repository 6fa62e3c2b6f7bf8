"""An effect of a sensor with two axes has one size, and what smoothing leaves of a turn has two."""

from __future__ import annotations

from functools import partial

import pytest
from campaign import ask, run
from campaign_cases import cases

from dart_hal.diagnose.policy import NamingPolicy, Policy


@pytest.fixture(scope="module")
def waves():
    """A drive in which nothing is hidden, commands in step with the messages."""
    return next(c for c in cases(["null"]) if c.seed == 77)


def seen(case, policy=None):
    """Names that the search arrived at, those that no other recording bears out included."""
    told = run(case, asked=partial(ask, policy=policy or Policy()))
    return [c["effect"] for c in (*told["causes"], *told["possible"])]


@pytest.mark.more
def test_what_smoothing_leaves_of_a_turn_is_no_lever_arm(waves):
    assert seen(waves) == []


@pytest.mark.more
def test_without_asking_both_axes_it_would_be_one(waves):
    assert seen(waves, Policy(naming=NamingPolicy(axes=1e9))) == ["imu_lever_arm"]
