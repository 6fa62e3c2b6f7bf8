"""Boxes that were carried off: distinguished from walls, and no reason to be lost; and what is
judged."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dart_hal.estimation.localisation.belief import start_belief
from dart_hal.estimation.localisation.field import map_of_grid, map_of_lines
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.estimation.localisation.health import Status, agreement
from dart_hal.estimation.localisation.localiser import Localiser
from dart_hal.estimation.localisation.rays import fastest_cast
from dart_hal.estimation.localisation.search import search
from dart_lab.sim.lidar.maps import box, room_of
from studies.localisation.figures import _warmed, wrongs
from studies.localisation.world import drive, hidden, run

HALL = box(3.0, 2.5, 0.0, 6.0, 5.0)
STOOL = box(4.5, 2.5, 0.3, 0.5, 0.3)
SHELF = box(3.0, 4.85, 0.0, 0.5, 0.3)


def test_a_box_is_what_is_small_and_touches_nothing():
    """A shelf against the wall is of the wall."""
    chart = map_of_lines(np.vstack((HALL, STOOL, SHELF)))
    assert np.array_equal(chart.walls, np.vstack((HALL, SHELF)))
    wide = np.vstack((HALL, box(3.0, 2.5, 0.0, 1.0, 0.3)))
    assert len(map_of_lines(wide).walls) == 8


def test_a_map_of_cells_has_boxes_too():
    occupied = np.ones((60, 80), dtype=bool)
    occupied[1:-1, 1:-1] = False
    occupied[20:28, 50:55] = True
    grid = Grid(occupied, ~occupied, 0.05, np.zeros(2))
    chart = map_of_grid(grid)
    lone = (chart.lines > 0.06).all(axis=1) & (chart.lines < 2.9).all(axis=1)
    assert lone.sum() == 4
    assert np.array_equal(chart.walls, chart.lines[~lone])


def simulate_scan(there, chart):
    turn = np.linspace(-np.pi, np.pi, 606, endpoint=False)
    ahead = np.column_stack((np.cos(turn), np.sin(turn)))
    origin = np.tile((2.0, 2.5), (606, 1))
    ends = (fastest_cast()(there, origin, ahead))[:, None] * ahead
    return agreement(chart, np.array((2.0, 2.5, 0.0, 0.0)), ends, ends, np.zeros_like(ends))


def test_through_a_box_that_is_gone_and_through_a_wall():
    """Another box behind it hides the wall, and decides nothing; the control is a wall gone."""
    chart = map_of_lines(np.vstack((HALL, STOOL, (2.5, 0.0, 2.5, 1.5))))
    full = simulate_scan(chart.lines, chart)
    assert full.share == full.score == 1.0
    gone = simulate_scan(np.vstack((HALL, chart.lines[-1:])), chart)
    assert gone.removed_boxes > 0.02
    assert gone.through_walls == 0.0
    assert gone.share + gone.removed_boxes == pytest.approx(1.0)
    moved = simulate_scan(np.vstack((HALL, box(5.3, 2.5, 0.3, 0.5, 0.3), chart.lines[-1:])), chart)
    assert moved.through_walls == 0.0
    assert 0.95 < moved.share + moved.removed_boxes < 1.0
    torn = simulate_scan(np.vstack((HALL, STOOL)), chart)
    assert torn.through_walls > 0.03
    assert torn.removed_boxes == 0.0


@pytest.mark.slow
def test_the_pose_that_is_judged_is_the_one_that_is_reported():
    """The match of these scans explains 95 % of them, at the right place: 0.7 to 0.4 m from what
    the filter makes of it."""
    d = drive(7107, hidden(7107))
    local = _warmed(d, 426)
    t = float(d.scans[426].t[-1]) - 0.01
    local.belief = start_belief(t, d.true(t) + np.array((-0.084, 0.774, 0.439)))
    results = []
    for before, scan in pairwise(d.scans[426:430]):
        for j in np.flatnonzero((d.t > before.arrival) & (d.t <= scan.arrival)):
            d.tell(local, int(j))
        results.append(local.add(scan))
    assert [simulate_scan.pose for simulate_scan in results] == [None] * 3
    assert results[-1].status is Status.LOST


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7101, 7105])
def test_wrong_poses_are_lost_and_good_ones_kept_with_half_the_boxes_gone(seed):
    counts = wrongs(seed, drive(seed, hidden(seed, stale=0.22, gone=2)))
    assert sum(counts[:3]) == 38
    assert counts[2:4] == [0, 0]


@pytest.mark.slow
def test_a_car_is_found_in_a_room_whose_boxes_have_all_moved():
    """After it has driven 4 m; the control is another room of the same outline, which fits one
    scan as well."""
    d = drive(5200, hidden(5200, stale=0.22, gone=4, seconds=7.0))
    found = run(d, localiser=Localiser(d.chart))
    assert found.off.max() < 0.03
    assert 4.0 < found.t[0] - d.t[0] < 6.0
    d = drive(5208, hidden(5208, seconds=31.0))
    other = map_of_lines(room_of("room", 6208).lines)
    beams = _warmed(d, 41)._beams(d.scans[41])
    match = search(other, beams.points, beams.rays, beams.origin)
    assert match.fits
    assert match.is_unique
    assert not match.is_known_room
    d = replace(d, scans=d.scans[41:100])
    assert not len(run(d, localiser=Localiser(other)).off)
