"""Parameters of cars from 1:43 to 1:1 are accepted; wrong units are refused all the same."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from dart_hal.core.config import Quantity
from dart_hal.core.config.car import Geometry
from dart_hal.core.errors import ConfigError
from dart_hal.vehicle.flat import bounds
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Body
from dart_hal.vehicle.scale import REFERENCE_MASS
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.sizes import list_differences, set_sizes

SCALES = {
    "1:43": (0.06, 0.041, 4e-5), "1:28": (0.098, 0.16, 2e-4), "1:10": (0.175, 1.67, 0.0065),
    "F1TENTH": (0.32, 3.33, 0.0687), "AutoRally 1:5": (0.57, 21.8, 1.1),
    "Hunter": (0.65, 72.0, 6.0), "kart": (1.05, 150.0, 30.0), "road car": (2.7, 1500.0, 2500.0)}
"""Wheelbase [m], mass [kg], yaw inertia [kg m2]."""


def body(wheelbase: float, mass: float, inertia: float) -> Body:
    return Body(wheelbase, 0.5 * wheelbase, 0.5 * wheelbase, mass, inertia)


@pytest.mark.parametrize("name", SCALES)
def test_car_of_every_scale_is_accepted(name):
    size = body(*SCALES[name])
    car = replace(PAPER, body=size, friction=replace(
        PAPER.friction, a=PAPER.friction.a * size.mass / REFERENCE_MASS))
    low, high = bounds(car, "friction.a")
    assert low <= car.friction.a <= high
    assert high >= 0.5 * size.mass * 9.81 or size.mass < REFERENCE_MASS


@pytest.mark.parametrize("wrong", [
    (0.175, 1670.0, 6.5), (175.0, 1.67, 0.0065), (17.5, 1.67, 0.0065), (0.175, 1.67, 6513.0),
    (0.175, 0.00167, 6.5e-6), (0.175, 1.67, 6.5e-6)],
    ids=["g", "mm", "cm", "g mm2", "t", "kg m2 x 1e-3"])
def test_wrong_unit_of_a_size_is_refused(wrong):
    with pytest.raises(ConfigError):
        body(*wrong)


def test_fit_of_a_small_car_keeps_the_limits_of_forces():
    """The limits a fit may reach are those of the 1:10 class, unless the car is heavier."""
    assert bounds(PAPER, "motor.d") == (0.0, 200.0)
    heavy = replace(PAPER, body=body(*SCALES["Hunter"]))
    assert bounds(heavy, "motor.d")[1] == pytest.approx(200.0 * 72.0 / REFERENCE_MASS)


@pytest.mark.slow
def test_a_set_for_another_car_has_forces_of_that_car():
    model = find_model("paper")[0]
    large = set_sizes(model, Geometry(wheelbase=2.6, l_f=1.3, l_r=1.3, mass=1000.0))
    old = vehicle_of(model)
    p = vehicle_of(large)
    assert p.friction.a == pytest.approx(512.0 * old.friction.a)
    assert p.friction.b == pytest.approx(old.friction.b / 4.0)
    assert p.motor.e == pytest.approx(128.0 * old.motor.e)
    assert p.tyres.rear_cornering_stiffness == pytest.approx(
        512.0 * old.tyres.rear_cornering_stiffness)
    assert p.tyres.front_B == old.tyres.front_B
    assert p.steering == old.steering


def test_drive_of_a_car_replaces_that_of_dart():
    model = find_model("paper")[0]
    sizes = {"wheelbase": 0.2, "l_f": 0.1, "l_r": 0.1, "mass": 2.0}
    assert vehicle_of(set_sizes(model, Geometry(**sizes))).body.front_share == 0.5
    rear = Geometry(**sizes, front_share=0.0)
    assert vehicle_of(set_sizes(model, rear)).body.front_share == 0.0
    all_wheels = set_sizes(model, Geometry(**sizes))
    assert "front_share 0.5 and not 0" in list_differences(all_wheels, rear)
    assert not list_differences(set_sizes(model, rear), rear)


def test_measured_forces_and_those_of_1_10_stay():
    model = find_model("paper")[0]
    measured = msgspec.structs.replace(model, friction={
        **model.friction, "a": Quantity(1.7, 0.1)})
    large = Geometry(wheelbase=2.6, l_f=1.3, l_r=1.3, mass=1000.0)
    assert set_sizes(measured, large).friction["a"] == Quantity(1.7, 0.1)
    similar = set_sizes(model, Geometry(wheelbase=0.2, l_f=0.1, l_r=0.1, mass=2.0))
    assert (similar.friction, similar.motor) == (model.friction, model.motor)
