"""Standard errors of sizes from car.toml: what carries them, and how lengths stay consistent."""

from __future__ import annotations

import pytest

from dart_hal.core.config import Quantity, plain
from dart_hal.core.config.car import Geometry, SizeErrors
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.flat import close_lengths, make_setter
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.sizes import list_differences, list_stated_errors, set_sizes

LENGTHS = {"wheelbase": 0.2, "l_f": 0.08, "l_r": 0.12}
GEOMETRY = {"wheelbase": 0.2, "l_f": 0.08, "l_r": 0.12, "mass": 2.0, "yaw_inertia": 0.01}


def size(**errors: float) -> Geometry:
    return Geometry(**GEOMETRY, std=SizeErrors(**errors))


@pytest.mark.parametrize(("changed", "expected"), [
    ({}, {}), ({"mass": 3.0}, {}),
    ({"wheelbase": 0.3}, {"wheelbase": 0.3, "l_f": 0.12, "l_r": 0.18}),
    ({"l_f": 0.09}, {"wheelbase": 0.2, "l_f": 0.09, "l_r": 0.11}),
    ({"l_r": 0.09}, {"wheelbase": 0.2, "l_f": 0.11, "l_r": 0.09}),
    ({"wheelbase": 0.21, "l_f": 0.09}, {"wheelbase": 0.21, "l_f": 0.09, "l_r": 0.12}),
    ({"wheelbase": 0.21, "l_r": 0.09}, {"wheelbase": 0.21, "l_f": 0.12, "l_r": 0.09}),
    ({"l_f": 0.3}, {"wheelbase": 0.2, "l_f": 0.196, "l_r": 0.004}),
    ({"l_r": 0.3}, {"wheelbase": 0.2, "l_f": 0.004, "l_r": 0.196})])
def test_two_lengths_give_the_third(changed, expected):
    assert close_lengths(LENGTHS, changed) == pytest.approx(expected)


def test_vehicle_of_a_fit_has_a_body_that_is_consistent():
    moved = make_setter(PAPER, ("body.wheelbase", "friction.a", "body.l_f"))((0.18, 1.0, 0.09))
    assert moved.friction.a == 1.0
    assert (moved.body.wheelbase, moved.body.l_f) == (0.18, 0.09)
    assert moved.body.l_r == pytest.approx(0.09)
    assert moved.body.mass == PAPER.body.mass
    heavier = make_setter(PAPER, ("body.mass",))((2.0,))
    assert (heavier.body.mass, heavier.body.l_r) == (2.0, PAPER.body.l_r)


def test_errors_of_car_toml_are_in_the_model_with_their_source():
    model = set_sizes(find_model("paper")[0], size(wheelbase=0.002, l_f=0.003, mass=0.05))
    assert model.body["wheelbase"] == Quantity(0.2, 0.002, "car.toml")
    assert model.body["l_r"] == pytest.approx(0.12)
    assert model.body["yaw_inertia"] == 0.01
    assert list_stated_errors(model) == {
        "body.wheelbase": 0.002, "body.l_f": 0.003, "body.mass": 0.05}
    assert vehicle_of(model).body.wheelbase == 0.2


def test_model_without_errors_is_the_same_as_before():
    model = set_sizes(find_model("paper")[0], size())
    assert {key: model.body[key] for key in GEOMETRY} == pytest.approx(GEOMETRY)
    assert not list_stated_errors(model)


def test_corrected_car_file_replaces_what_an_older_one_stated():
    old = set_sizes(find_model("paper")[0], size(wheelbase=0.002, mass=0.05))
    new = set_sizes(old, Geometry(**{**GEOMETRY, "mass": 2.2}, std=SizeErrors(mass=0.01)))
    assert new.body["mass"] == Quantity(2.2, 0.01, "car.toml")
    assert new.body["wheelbase"] == 0.2
    assert plain(new.body["yaw_inertia"]) == 0.01


def test_error_that_is_not_from_car_toml_frees_no_size():
    model = find_model("paper")[0]
    model.body["mass"] = Quantity(1.67, 0.01)
    assert not list_stated_errors(model)
    assert plain(set_sizes(model, size(mass=0.05)).body["mass"]) == 1.67, "it was measured"


@pytest.mark.parametrize(("fitted", "std", "differ"), [
    (0.0125, 0.001, False), (0.0125, 0.0001, False), (0.02, 0.001, True)])
def test_a_size_that_a_fit_moved_within_its_error_is_no_difference(fitted, std, differ):
    """yaw_inertia is 0.01 +- 0.002 in car.toml."""
    model = set_sizes(find_model("paper")[0], size())
    model.body["yaw_inertia"] = Quantity(fitted, std, "joint fit")
    assert bool(list_differences(model, size(yaw_inertia=0.002))) == differ
