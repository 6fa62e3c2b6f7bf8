"""A small version of ``python -m studies.control.overtaking``."""

from __future__ import annotations

import pytest

from dart_hal.estimation.other_cars.tracker import CarTracker
from studies.control.overtaking import LANES, OWN_SPEED, PersonAtRest, meet


@pytest.mark.slow
@pytest.mark.parametrize(("tracker", "share"), [("mpcc", 0.0), ("mpcc", 0.3), ("ca-mpcc", 0.3)])
@pytest.mark.long_except("*-0.3")
def test_in_a_wide_lane_a_slower_car_is_overtaken(tracker, share):
    drive = meet(3, share, LANES["wide"], tracker, seconds=16.0)
    assert not drive.touched
    assert drive.passed
    assert not drive.lane_left


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.6])
def test_in_a_narrow_lane_the_car_stays_behind(share):
    """With the gap in which it stops even if the other one stops at once."""
    drive = meet(2, share, LANES["narrow"], "mpcc", seconds=12.0)
    assert not drive.touched
    assert not drive.passed
    assert drive.headway > 0.9
    assert drive.rows[-1, 2] == pytest.approx(share * OWN_SPEED, abs=0.25)


@pytest.mark.slow
def test_control_without_tracks_the_cars_touch():
    assert meet(2, 0.3, LANES["wide"], "mpcc", blind=True, seconds=9.0).touched


@pytest.mark.slow
def test_it_waits_before_a_person_at_rest_in_a_wide_lane(monkeypatch):
    options = {"seconds": 7.0, "make_world": PersonAtRest}
    drive = meet(2, 0.0, LANES["wide"], "mpcc", **options)
    assert not drive.touched
    assert not drive.passed
    assert drive.follower.free == 0.0
    monkeypatch.setattr(CarTracker, "list_possible", lambda self, t: ())
    assert meet(2, 0.0, LANES["wide"], "mpcc", **options).touched, "the control"
