"""Cars whose track has ended: predicted, then lost, then forgotten where beams pass through."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.estimation.other_cars.memory import (
    COAST_TIME,
    FORGET_TIME,
    is_place_free,
    list_nearby,
    remember_cars,
)
from dart_hal.estimation.other_cars.rectangle import CarSize
from dart_hal.estimation.other_cars.sweep import RoomBeams
from dart_hal.estimation.other_cars.tracks import start_track

BODY = CarSize(0.30, 0.19, 0.0875)
TRACKED = start_track(1, 5.0, np.array((2.0, 0.0)), np.array((0.6, 0.0)), BODY.centre_x)


def sweep_of(distance, t=5.0):
    """Beams from the origin along +x that all end at a distance [m]."""
    angle = np.linspace(-0.3, 0.3, 61)
    beams = np.full(61, distance)
    return RoomBeams(np.full(61, t), np.zeros((61, 2)),
                     np.column_stack((np.cos(angle), np.sin(angle))), beams, np.full(61, 6.0),
                     np.zeros(61, bool))


def test_a_car_without_a_track_is_predicted_and_then_lost():
    (soon,) = list_nearby((TRACKED,), 5.5)
    assert (soon.age, soon.speed, soon.lost) == (0.5, pytest.approx(0.6), False)
    (later,) = list_nearby((TRACKED,), 5.0 + COAST_TIME + 0.1)
    assert later.lost
    assert later.pose.x == pytest.approx(2.0 - BODY.centre_x)


def test_the_uncertainty_along_the_path_grows_faster_than_the_age():
    near, far = (list_nearby((TRACKED,), 5.0 + age)[0].along_std for age in (0.5, 1.0))
    assert far > 2.0 * near > 0.2


def test_it_is_forgotten_only_once_beams_pass_through_its_place():
    late = 5.0 + FORGET_TIME + 0.1
    assert remember_cars((TRACKED,), (), sweep_of(6.0, late), BODY) == ()
    assert remember_cars((TRACKED,), (), sweep_of(1.0, late), BODY) == (TRACKED,)
    assert remember_cars((TRACKED,), (), sweep_of(6.0, 5.0 + COAST_TIME), BODY) == (TRACKED,)


def test_beams_that_end_on_it_or_before_it_do_not_free_its_place():
    assert is_place_free(TRACKED, sweep_of(6.0), BODY)
    assert not is_place_free(TRACKED, sweep_of(1.87), BODY)
    assert not is_place_free(TRACKED, sweep_of(0.5), BODY)


def test_a_new_track_where_it_is_expected_replaces_it():
    """After 1 s it has driven 0.6 m."""
    moved = replace(TRACKED, number=2, t=6.0, mean=np.add(TRACKED.mean, (0.7, 0, 0, 0, 0)))
    assert remember_cars((TRACKED,), (moved,), sweep_of(6.0, 6.0), BODY) == (moved,)
    other = replace(moved, mean=np.add(TRACKED.mean, (3.0, 0, 0, 0, 0)))
    assert remember_cars((TRACKED,), (other,), sweep_of(6.0, 6.0), BODY) == (other, TRACKED)
