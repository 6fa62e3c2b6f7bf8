"""The racetrack by lidar poses: a small version of ``python -m studies.control.lidar_figures``."""

from __future__ import annotations

import numpy as np
import pytest

from studies.control.lidar_figures import driven

FRESH = range(101, 121)
"""None of the cars on which anything was tuned."""


@pytest.mark.slow
def test_a_car_that_looks_about_keeps_to_the_path():
    """Clockwise, found without a start, with mixed pixels and boxes that no map shows."""
    drive = driven(102, 2.0, laps=1)
    assert drive.good
    assert drive.figures["rms"] < 0.03
    assert drive.figures["max"] < 0.10


@pytest.mark.slow
def test_gaps_spins_and_another_car_lose_it_not():
    drive = driven(103, 2.0, laps=2, faults=True)
    assert drive.good
    assert drive.figures["rms"] < 0.05


@pytest.mark.slow
def test_control_without_the_bridge_the_first_gap_ends_the_drive():
    drive = driven(103, 2.0, laps=1, faults=True, bridge=False)
    assert "the pose was lost" in drive.follower.why
    assert drive.way[-1] < 14.0


@pytest.mark.long
@pytest.mark.parametrize(("speed", "rms"), [(2.0, 0.03), (1.0, 0.02)])
def test_twenty_cars_stay_on_the_path(speed, rms):
    drives = [driven(seed, speed) for seed in FRESH]
    assert all(d.good for d in drives)
    assert max(d.figures["rms"] for d in drives) < rms
    assert max(d.figures["max"] for d in drives) < 0.10
    assert np.abs([d.figures["lap"] for d in drives]).max() < 0.03


@pytest.mark.long
def test_no_car_is_lost_in_a_hundred_laps_with_faults():
    drives = [driven(seed, 2.0, laps=10, faults=True) for seed in FRESH[:10]]
    assert all(d.good for d in drives)
    assert sum(len(d.follower.driven.lap_times) for d in drives) == 100
