"""Emulated cars of a fleet live in one time, after any history of each."""

from __future__ import annotations

import pytest

from dart_hal.car import Car, Fleet
from dart_hal.core.errors import LinkLost
from dart_hal.core.timing import SAMPLE
from tests.fleet.rooms import FleetPins

LOCKSTEP_URLS = ["sim://?nano=mock&seed=1", "sim://?nano=mock&seed=2"]


@pytest.mark.slow
def test_a_fleet_brings_its_cars_to_one_time():
    with Fleet.open(LOCKSTEP_URLS, room="local://time") as fleet:
        for _ in fleet.cars[0].states(duration=0.5):
            pass
        difference = abs(fleet.cars[0].now - fleet.cars[1].now)
        ages = []
        for _ in fleet.states(duration=0.3):
            ages += [other.age for name in fleet.names
                     for other in fleet.other_poses(name).values()]
        assert difference > 0.4, "control"
        assert abs(fleet.cars[0].now - fleet.cars[1].now) <= 1.1 * SAMPLE
        assert len(ages) > 50
        assert max(ages[10:]) < 0.05 + 3 * SAMPLE, "a period, a look, and a tick between the cars"


@pytest.mark.slow
def test_all_arm_at_once():
    with FleetPins("local://arm", seeds=(1, 2, 3)) as pins:
        pins.fleet.arm()
        assert {car.mode for car in pins.fleet.cars} == {"ARMED"}
        assert max(pins.now()) < 4.0, "one after the other takes 3 s each"
        assert max(pins.now()) - min(pins.now()) < 0.2


def test_an_error_of_one_car_names_it():
    with Fleet.open(["sim://?nano=mock&seed=1", "sim://?nano=mock&seed=2"]) as fleet:
        fleet.cars[1].close()
        for call in (fleet.arm, lambda: list(fleet.states(duration=0.1))):
            with pytest.raises(LinkLost, match=f"car {fleet.names[1]}: the car is closed"):
                call()


@pytest.mark.slow
def test_closing_stops_all_cars_before_it_waits_for_the_first(monkeypatch):
    """Closing takes 0.2 s a car, and a command stays valid for half a second."""
    close = Car.close
    moving = []

    def note_and_close(car):
        moving.append([c._engine.driver.applied.throttle > 0.0
                       for c in fleet.cars])
        close(car)

    with Fleet.open(LOCKSTEP_URLS) as fleet:
        fleet.arm()
        for _ in fleet.states(duration=0.2):
            for car in fleet.cars:
                car.drive(throttle=0.2, valid_for=0.5)
        assert all(car._engine.driver.applied.throttle > 0.1 for car in fleet.cars), "control"
        monkeypatch.setattr(Car, "close", note_and_close)
    assert moving == [[False, False]] * 2
