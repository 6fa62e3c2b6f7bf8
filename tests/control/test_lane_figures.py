"""The figures of docs/results/following.md for lanes, on hidden cars that err about themselves."""

from __future__ import annotations

import numpy as np
import pytest

from studies.control.lane_figures import driven

FRESH_SEEDS = range(201, 221)
"""None of the cars on which anything was tuned."""
MAX_RMS_CM = {"lane": 1.0, "lane-curve": 1.5, "lane-s": 1.5}
"""cm rms after the first 2 m, of the worst car at 1 m/s."""


def measure_final_error(learns):
    """Largest error [cm] between 2.2 and 2.8 m of a straight lane."""
    drive = driven(201, 1.0, "lane", learns=learns, distance=2.9)
    assert drive.follower.why == "2.9 m are driven"
    way = drive.s - drive.s[0]
    return 100.0 * float(np.abs(drive.error[(way > 2.2) & (way < 2.8)]).max())


@pytest.mark.slow
def test_a_car_comes_to_the_middle():
    assert measure_final_error(learns=True) < 1.5


@pytest.mark.slow
def test_without_what_it_learns_it_stays_off_the_middle():
    """The control."""
    assert measure_final_error(learns=False) > 1.5


@pytest.mark.long
@pytest.mark.parametrize("name", MAX_RMS_CM)
def test_the_true_axle_stays_in_the_middle(name):
    drives = [driven(seed, 1.0, name) for seed in FRESH_SEEDS]
    assert {d.follower.why for d in drives} == {"the lane ends"}
    assert max(d.figures["rms"] for d in drives) < MAX_RMS_CM[name]
    assert all(0.15 < d.figures["left"] < 0.5 for d in drives)


@pytest.mark.long
@pytest.mark.parametrize("name", ["lane", "lane-s"])
def test_without_what_it_learns_it_does_not(name):
    """The control."""
    rms = [driven(seed, 1.0, name, learns=False).figures["rms"] for seed in FRESH_SEEDS]
    assert np.sum(np.array(rms) > MAX_RMS_CM[name]) >= len(rms) / 3


@pytest.mark.long
def test_at_twice_the_speed_it_keeps_the_lane():
    for seed in FRESH_SEEDS[:4]:
        drive = driven(seed, 2.0, "lane-s")
        assert drive.follower.why == "the lane ends"
        assert drive.figures["max"] < 8.0
