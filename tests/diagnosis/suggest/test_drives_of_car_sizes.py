"""Suggested drives of a car of another size are those of 1:10, on a floor of its size."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.file import model_of
from dart_lab.diagnosis.suggest.library import (
    CHOICES,
    REST_S,
    default_floor,
    rehearse_choices,
)
from tests.diagnosis.scaled_drive import CAR_SIZES, Size

SUGGESTED_WEAVE = next(c for c in CHOICES if c.name == "weave")


@pytest.fixture(scope="module")
def reference():
    """The drive of the car of the paper, without a model of its own."""
    return next(rehearse_choices(default_floor(PAPER.body), choices=(SUGGESTED_WEAVE,)))


@pytest.mark.slow
@pytest.mark.parametrize("length", [0.25, 1.0, 8.0])
def test_a_drive_is_stretched_in_time_and_its_floor_by_the_length(reference, length):
    body = PAPER.body
    car = Size(length * body.wheelbase, length**3 * body.mass).scale(PAPER)
    floor = default_floor(car.body)
    assert floor.length == floor.width == 10.0 * length
    drive = next(rehearse_choices(floor, model_of(car), (SUGGESTED_WEAVE,)))
    driving = drive.seconds - 2.0 * REST_S
    assert driving == pytest.approx(length**0.5 * (reference.seconds - 2.0 * REST_S), rel=0.01)
    for one, other in zip(drive.commands, reference.commands, strict=True):
        assert one.throttle.max() == pytest.approx(other.throttle.max(), rel=0.01)
        assert np.ptp(one.steering) == pytest.approx(np.ptp(other.steering), rel=0.01)
    assert bool(drive.shell_commands) is (length == 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", CAR_SIZES)
def test_a_car_of_each_size_has_a_drive_on_its_own_floor(name):
    car = CAR_SIZES[name].scale(PAPER)
    drives = list(rehearse_choices(default_floor(car.body), model_of(car), (SUGGESTED_WEAVE,)))
    assert len(drives) == 1


@pytest.mark.slow
def test_control_the_floor_of_1_10_is_too_small_for_a_car_of_1_1():
    car = CAR_SIZES["1:1"].scale(PAPER)
    assert not list(rehearse_choices(default_floor(PAPER.body), model_of(car), (SUGGESTED_WEAVE,)))
