"""A small version of ``python -m studies.mapping.figures``: a room, and the ring of one seed."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.mapping.occupancy import grid_of
from studies.localisation.figures import rms
from studies.localisation.world import drive, hidden
from studies.mapping.figures import CLOSED, TURNED, localised, outer, written
from studies.mapping.world import again, around, gap, mapped, placed_on, walls


@pytest.mark.slow
def test_a_car_of_hidden_errors_maps_what_it_sees_in_six_seconds():
    d = drive(6002, hidden(6002, seconds=6.0))
    survey = mapped(d)
    placed = placed_on(survey, d)
    off, which = walls(grid_of(survey), placed, d.lines)
    assert len(survey.frames) > 15
    assert rms(placed.off) < 0.01
    assert np.median(off[outer(d)[which]]) < 0.01


@pytest.mark.slow
def test_a_room_is_mapped_and_the_car_finds_itself_in_the_file():
    d = drive(6000, hidden(6000))
    survey = mapped(d)
    placed = placed_on(survey, d)
    grid = written(grid_of(survey))
    off, which = walls(grid, placed, d.lines)
    assert np.median(off[outer(d)[which]]) < 0.01
    assert (off > 0.02).mean() < 0.02
    second = again(6000, hidden(6500, seconds=20.0))
    away = localised(grid, second, placed)
    assert len(away) > 0.7 * len(second.scans)
    assert rms(away) < 0.015
    fresh = drive(6000, hidden(6000, seconds=20.0))
    assert rms(placed_on(mapped(fresh, deskew=False), fresh).off) > 5.0 * rms(placed.off)


@pytest.mark.slow
def test_the_ring_closes_and_without_closures_does_not():
    """Of a car that drifts by more than 1 cm in a lap: not all do."""
    d = around(6000, hidden(6000, speed=2.0, other=False))
    for closing in (True, False):
        off, turn = gap(placed_on(mapped(d, closing=closing), d))
        assert bool(off < CLOSED and turn < TURNED) is closing
