"""The figures of docs/results/following.md, on hidden cars with electronics and motion capture."""

from __future__ import annotations

import pytest

from studies.control.follow_figures import driven

pytestmark = pytest.mark.long
CAR_SEEDS = (21, 22)
"""None of the cars on which anything was tuned."""


@pytest.mark.parametrize(("tracker", "speed", "rms", "largest"), [
    ("lqr", 1.0, 0.02, 0.05), ("lqr", 2.0, 0.03, 0.10), ("pursuit", 1.0, 0.02, 0.05),
    ("mpcc", 2.0, 0.035, 0.10)])
@pytest.mark.parametrize("seed", CAR_SEEDS)
def test_the_true_axle_stays_on_the_path(seed, tracker, speed, rms, largest):
    drive = driven(seed, speed, "later", tracker, laps=2.0)
    assert drive.follower.why == "the path is driven"
    found = drive.figures
    assert found["rms"] < rms
    assert found["max"] < largest
    assert abs(found["lap"]) < 0.03


@pytest.mark.parametrize("seed", CAR_SEEDS)
def test_a_raceline_is_driven_as_fast_as_its_profile(seed):
    drive = driven(seed, 2.0, "later", laps=2.0, half_width=0.3)
    assert drive.follower.why == "the path is driven"
    assert drive.follower.path.length < 22.0
    found = drive.figures
    assert found["rms"] < 0.03
    assert abs(found["lap"]) < 0.03


@pytest.mark.parametrize("tracker", ["pursuit", "mpcc"])
@pytest.mark.parametrize("seed", CAR_SEEDS)
def test_without_delay_compensation_it_does_not(seed, tracker):
    """The control."""
    blind = driven(seed, 2.0, "later", tracker, laps=1.0, blind=True)
    assert blind.figures["rms"] > 0.08


@pytest.mark.parametrize("seed", CAR_SEEDS)
def test_the_papers_tyres_are_known_to_hold_less(seed):
    """1.4 m/s in turns of 0.75 m: with a target of 2, it drives the profile and stays in the
    lane."""
    drive = driven(seed, 2.0, "paper", laps=1.0)
    assert drive.follower.why == "the path is driven"
    assert drive.wanted[drive.settled:].min() < 1.5
    assert drive.figures["rms"] < 0.03
