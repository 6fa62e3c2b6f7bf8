"""What the driver reports to the Nano, and what it takes for a reason to wait or to trip."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import pytest

from dart_hal.car import Car
from dart_hal.car.driver import Driver
from dart_hal.devices.links.base import open_backend
from tests.common import MOCK_1_URL


class Suspended:
    """In the place of ``SuspendDetector``: the computer was suspended just now."""

    def was_suspended(self) -> bool:
        return True


@pytest.mark.parametrize("virtual", [True, False])
def test_a_suspend_trips_a_car_in_real_time_alone(virtual):
    """In virtual time the world waits for its program."""
    backend = open_backend(MOCK_1_URL)
    with Car.over(backend) as car, patch("dart_hal.car.driver.SuspendDetector", Suspended):
        engine = car._engine
        driver = Driver(car.files, replace(backend, virtual=virtual), engine.transmitter,
                        engine.receiver)
        assert ("SUSPENDED" in driver._causes(car.now)) != virtual


@pytest.mark.slow
@pytest.mark.parametrize(("throttle", "direction"), [(0.3, 1), (0.0, 0), (-0.3, -1)])
def test_each_heartbeat_reports_in_which_direction_the_throttle_acts(throttle, direction):
    """Where it changes while the wheels turn, the Nano marks the edges as ambiguous."""
    directions: list[int] = []
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        transmitter = car._engine.transmitter
        send = transmitter.heartbeat

        def note(applied, mode, token, direction, now):
            directions.append(direction)
            send(applied, mode, token, direction, now)

        with patch.object(transmitter, "heartbeat", note):
            for _ in car.states(duration=0.1):
                car.drive(throttle=throttle)
    assert directions[-1] == direction


@pytest.mark.parametrize(("good_for", "expected"), [(0.05, False), (0.15, True)])
def test_the_link_is_stable_after_a_tenth_of_a_second_without_a_gap(good_for, expected):
    with Car.open(MOCK_1_URL) as car:
        for _ in car.states(duration=0.5):
            pass
        driver = car._engine.driver
        assert driver.is_settled(car.now)
        driver.observer._good_since = car.now - good_for
        assert driver.is_settled(car.now) == expected
