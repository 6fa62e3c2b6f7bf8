"""A small version of ``python -m studies.detection.figures``: one room, a car, people."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.other_cars.rectangle import CarSize
from dart_hal.estimation.other_cars.sweep import RoomBeams
from dart_hal.estimation.other_cars.tracker import CarTracker
from studies.detection.figures import Errors, evaluate
from studies.detection.world import scene


@pytest.fixture(scope="module")
def tracked():
    errors = Errors()
    evaluate(scene(802, seconds=15.0), errors)
    return errors


@pytest.mark.slow
def test_another_car_is_followed_within_4_metres(tracked):
    rows = np.array(tracked.rows)
    rows = rows[rows[:, 0] < 4.0]
    assert len(rows) > 40
    assert np.mean(rows[:, 1] < 0.05) > 0.9
    assert np.mean(rows[:, 2] < 0.15) > 0.9
    assert min(tracked.delays) < 1.2
    assert tracked.false_scans < 0.05 * tracked.scans


@pytest.mark.slow
def test_people_are_no_cars():
    errors = Errors()
    evaluate(scene(803, car=False, people=2, seconds=15.0), errors)
    assert errors.false_scans < 0.05 * errors.scans
    assert errors.scans > 100


@pytest.mark.slow
def test_control_a_car_of_another_size_is_not_followed(monkeypatch):
    """The tracker looks for cars of 0.9 x 0.6 m."""
    monkeypatch.setattr("studies.detection.figures.SIZE", CarSize(0.9, 0.6, 0.2))
    errors = Errors()
    evaluate(scene(802, seconds=8.0, people=0), errors)
    assert not errors.rows


def test_an_empty_sweep_has_no_track():
    size = CarSize(0.30, 0.19, 0.0875)
    empty = RoomBeams(*np.zeros((1, 0)), *np.zeros((2, 0, 2)), *np.zeros((2, 0)), np.zeros(0, bool))
    assert CarTracker(size).add(empty) == ()
