"""A small version of ``python -m studies.detection.figures``: one room, a car, people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.estimation.other_cars.rectangle import CarSize
from dart_hal.estimation.other_cars.sweep import RoomBeams
from dart_hal.estimation.other_cars.tracker import (
    MAX_CANDIDATE_GAP,
    MIN_POSSIBLE_FITS,
    CarTracker,
)
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


@pytest.mark.slow
def test_a_car_at_rest_is_found_and_nothing_else_is_where_nothing_is():
    errors = Errors()
    evaluate(scene(700, speed=0.0, seconds=15.0), errors)
    rows = np.array(errors.rows)
    assert len(rows) > 40
    assert np.mean(rows[:, 1] < 0.05) > 0.9
    assert np.mean(rows[:, 2] < 0.15) > 0.9
    assert errors.false == 0
    assert not errors.at_rest["nothing"]


def make_seam_sweep(t, car=True):
    """A revolution about the origin that begins at +x, where a car of 0.19 m is 2 m away."""
    angle = -np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False)
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    on_car = (np.abs(direction[:, 1]) < 0.0475) & (direction[:, 0] > 0.0) & car
    wall = np.full(600, 4.0)
    return RoomBeams(t + 2e-4 * np.arange(600), np.zeros((600, 2)), direction,
                     np.where(on_car, 2.0 / np.maximum(direction[:, 0], 0.5), wall), wall, on_car)


@pytest.mark.parametrize(("cuts", "speed"), [(True, 0.05), (False, np.inf)])
def test_a_car_over_the_seam_of_the_scans_is_one_track_at_rest(monkeypatch, cuts, speed):
    """The control: its halves, seen 0.12 s after each other, make no track at rest in 1 s."""
    if not cuts:
        monkeypatch.setattr(CarTracker, "_cut", lambda self, sweep: sweep)
    tracker = CarTracker(CarSize(0.30, 0.19, 0.0875))
    for k in range(12):
        tracks = tracker.add(make_seam_sweep(0.12 * k))
    found = [track for track in tracks if track.at_rest and abs(track.mean[1]) < 0.03]
    assert bool(found) is cuts
    assert all(abs(track.mean[3]) < speed for track in found)


def test_what_two_turns_show_is_a_possible_car_until_it_is_confirmed():
    tracker = CarTracker(CarSize(0.30, 0.19, 0.0875))
    found = []
    for k in range(16):
        confirmed = tracker.add(make_seam_sweep(0.12 * k))
        found.append((len(tracker.list_possible(0.12 * (k + 1))), len(confirmed)))
    start = found.index((1, 0))
    end = found.index((0, 1))
    assert start == MIN_POSSIBLE_FITS - 1
    assert 6 < end < 16
    assert found == [(0, 0)] * start + [(1, 0)] * (end - start) + [(0, 1)] * (16 - end)


def test_a_possible_car_is_at_its_last_place_and_vanishes_with_its_beams():
    tracker = CarTracker(CarSize(0.30, 0.19, 0.0875))
    for k in range(3):
        tracker.add(make_seam_sweep(0.12 * k))
    (possible,) = tracker.list_possible(0.36)
    assert possible.centre == pytest.approx((2.12, 0.0), abs=0.08)
    for k in range(3, 9):
        tracker.add(make_seam_sweep(0.12 * k, car=False))
        t = 0.12 * (k + 1)
        if tracker.list_possible(t):
            assert t - possible.t < MAX_CANDIDATE_GAP + 0.25
    assert not tracker.list_possible(t)


def test_what_rests_and_is_no_car_is_a_possible_car():
    """A leg of 0.06 m; the control: not before it has rested for 2 s."""
    tracker = CarTracker(CarSize(0.30, 0.19, 0.0875))
    for k in range(24):
        sweep = make_seam_sweep(0.12 * k)
        on_leg = sweep.unexplained & (np.abs(sweep.direction[:, 1]) < 0.015)
        wall = np.where(on_leg, sweep.range, sweep.wall)
        assert tracker.add(replace(sweep, range=wall, unexplained=on_leg)) == ()
        found = tracker.list_possible(0.12 * (k + 1))
        assert bool(found) == (k > 17), k
    assert found[0].centre == pytest.approx((2.0, 0.0), abs=0.05)


def test_an_empty_sweep_has_no_track():
    size = CarSize(0.30, 0.19, 0.0875)
    empty = RoomBeams(*np.zeros((1, 0)), *np.zeros((2, 0, 2)), *np.zeros((2, 0)), np.zeros(0, bool))
    assert CarTracker(size).add(empty) == ()
