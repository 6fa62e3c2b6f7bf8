"""What passes through a wall of the map: another room is refused, one that has changed is not."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.health import (
    BEAM_STRIDE,
    MIN_PROOF,
    Agreement,
    Status,
    TrackJudge,
    agreement,
)
from dart_hal.estimation.localisation.search import search
from dart_lab.sim.lidar.maps import box
from studies.localisation.figures import _warmed
from studies.localisation.world import drive, hidden, run


@pytest.mark.parametrize("seed", [5100, 5102, 5104])
@pytest.mark.slow
def test_another_room_of_the_same_outline_is_refused(seed):
    """By one of its scans; the control is the own room."""
    d = drive(seed, hidden(seed, seconds=3.0))
    chart = drive(seed + 1, hidden(seed + 1)).chart
    beams = _warmed(d, 4)._beams(d.scans[4])
    found = [search(c, beams.points, beams.rays, beams.origin) for c in (d.chart, chart)]
    assert [f.fits and f.is_unique for f in found] == [True, False]


def test_a_few_beams_through_walls_weigh_where_the_room_is_in_question():
    agreed = Agreement(0.8, 0.03)
    assert agreed.share > MIN_PROOF > agreed.proof()


def test_one_beam_past_an_edge_is_no_way_through_a_wall():
    """It grazes, or is mixed of both sides; the control is two next to each other."""
    chart = map_of_lines(box(0.0, 0.0, 0.0, 4.0, 4.0))
    turn = np.linspace(0.0, 2.0 * np.pi, 603)
    for beams, passed in ((1, 0.0), (2, 2.0 / 201.0)):
        reach = np.full(603, 1.0)
        reach[:BEAM_STRIDE * beams:BEAM_STRIDE] = 3.0
        ends = reach[:, None] * np.column_stack((np.cos(turn), np.sin(turn)))
        found = agreement(chart, np.zeros(4), ends, np.zeros_like(ends), np.zeros_like(ends))
        assert found.through_walls == pytest.approx(passed)


def test_a_searched_track_in_another_room_is_given_up():
    judge = TrackJudge(0.8, Agreement(0.8, 0.0))
    statuses = [judge.add(Agreement(0.8, 0.05)) for _ in range(20)]
    assert statuses[-1] is Status.LOST
    assert TrackJudge(0.8).add(Agreement(0.8, 0.05)) is Status.TRACKING  # given start


@pytest.mark.slow
def test_a_room_without_half_its_boxes_is_not_lost():
    d = drive(5302, hidden(5302, stale=0.22, gone=2, seconds=15.0))
    found = run(d)
    assert Status.LOST not in {t.status for t in found.told if t}
    assert found.off.max() < 0.02
