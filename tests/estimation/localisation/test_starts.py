"""Where the car is without a given start: found, kidnapped and found again, refused when
mirrored."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.localisation import localiser
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.health import Status
from dart_hal.estimation.localisation.localiser import Localiser
from dart_hal.estimation.localisation.search import search, search_period
from dart_lab.sim.lidar.maps import room_of
from studies.localisation.figures import kidnapped
from studies.localisation.world import drive, hidden, run


def test_a_car_is_found_without_a_start_and_reported_only_when_proven():
    d = drive(2005, hidden(2005, seconds=3.0))
    r = run(d, localiser=Localiser(d.chart))
    assert [result.pose is None for result in r.told[:6]] == [True] * 5 + [False]
    assert r.off.max() < 0.02


@pytest.mark.slow
def test_a_kidnapped_car_is_lost_and_comes_back():
    d = kidnapped(drive(2005, hidden(2005, seconds=26.0)))
    r = run(d, localiser=Localiser(d.chart))
    lost = next(result.t for result in r.told if result and result.t > 14.9 and result.pose is None)
    assert lost < 15.5
    assert (r.off[r.t > 17.5] < 0.03).all()
    assert (r.t > 17.5).sum() > 30


@pytest.mark.slow
def test_scans_that_turn_against_the_gyro_are_refused():
    """The control is the same drive with the right sense."""
    for sense, good in ((1.0, True), (-1.0, False)):
        d = drive(2003, hidden(2003, seconds=15.0, sense=sense))
        last = [result for result in run(d, localiser=Localiser(d.chart)).told if result][-1]
        assert (last.status is not Status.LOST) is good
        assert last.mirrored is not good
        assert (last.pose is not None) is good


@pytest.mark.slow
def test_the_gap_of_a_second_is_bridged():
    d = drive(2003, hidden(2003, seconds=12.0, gap=1.0))
    r = run(d)
    assert np.diff(r.t).max() > 0.9
    assert r.off.max() < 0.03


@pytest.mark.slow
def test_searches_while_lost_take_a_limited_share_of_the_time(monkeypatch):
    """In another room; the control is a limit of the share that no search reaches."""
    d = drive(2005, hidden(2005, seconds=4.0))
    other = map_of_lines(room_of("room", 2006).lines)
    counts = []
    for period in (search_period(other), 0.0):
        searched = []
        monkeypatch.setattr(localiser, "search_period", lambda chart, period=period: period)
        monkeypatch.setattr(localiser, "search",
                            lambda *scan, searched=searched: searched.append(1) or search(*scan))
        assert not len(run(d, localiser=Localiser(other)).t)
        counts.append(len(searched))
    scans = len(d.scans)
    assert counts[1] == scans
    assert counts[0] <= 1 + (d.scans[-1].t[-1] - d.scans[0].t[-1]) / search_period(other) < scans
