"""A trip is reported to a program that goes on commanding."""

from __future__ import annotations

import inspect
import logging
import re

import pytest

from dart_hal.car import Car, driver, guarding
from dart_hal.core.errors import BadCommand, Disarmed
from dart_hal.devices.actuation import chain, guarded
from dart_hal.devices.actuation.trips import TRIPS
from tests.common import MOCK_1_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


def expire(car: Car) -> None:
    """Let a command with throttle run out."""
    car.drive(throttle=0.2)
    for _ in car.states(duration=0.4):
        pass
    assert car.causes == ("COMMAND_EXPIRED",)


def drive_on(car: Car) -> None:
    for _ in car.states(duration=4.0, timeout=3.0):
        car.drive(throttle=0.1)


@pytest.mark.slow_except("*0")
@pytest.mark.parametrize("command", [
    lambda car: car.drive(throttle=0.1), lambda car: car.drive_speed(steering=0.0, speed=0.3)])
def test_a_command_to_a_car_that_tripped_raises_until_it_is_armed(command):
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        expire(car)
        for _ in range(2):
            with pytest.raises(Disarmed) as caught:
                command(car)
        assert caught.value.causes == ("COMMAND_EXPIRED",)
        assert "valid" in caught.value.found
        car.arm()
        assert "NOT_ARMED" not in command(car).limited


def test_the_error_does_not_trip_the_car_once_more():
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        expire(car)
        with pytest.raises(Disarmed):
            car.drive(throttle=0.1)
        next(car.states())
        assert car.causes == ("COMMAND_EXPIRED",)


def test_a_program_may_look_by_itself():
    with Car.open(MOCK_1_URL, raise_on_trip=False) as car:
        car.arm()
        expire(car)
        assert "NOT_ARMED" in car.drive(throttle=0.1).limited


def test_a_car_that_was_never_armed_takes_commands_in_silence():
    with Car.open(MOCK_1_URL) as car:
        assert "NOT_ARMED" in car.drive(throttle=0.1).limited


def test_after_its_own_stop_a_program_knows():
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        car.stop()
        assert "NOT_ARMED" in car.drive(throttle=0.1).limited


def test_a_stop_answers_a_trip():
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        expire(car)
        car.stop()
        assert "NOT_ARMED" in car.drive(throttle=0.1).limited


@pytest.mark.slow
def test_a_reboot_of_the_nano_is_reported_too():
    with Car.open(MOCK_1_URL + "&fail=mcu:reset@4") as car:
        car.arm()
        with pytest.raises(Disarmed) as caught:
            drive_on(car)
        assert set(caught.value.causes) <= {"LINK_STALE", "MCU_REBOOTED"}


def test_an_invalid_command_raises_as_such_first():
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        with pytest.raises(BadCommand):
            car.drive(throttle=float("nan"))
        for _ in car.states(duration=0.05):
            pass
        with pytest.raises(Disarmed) as caught:
            car.drive(throttle=0.1)
        assert caught.value.causes == ("COMMAND_INVALID",)


def test_every_cause_that_the_code_names_has_its_words():
    """Arguments of the calls that trip, read from the sources of actuator, driver and guard."""
    calls = re.compile(r'(?:_trip|_trips\.append|causes\.append|_note_bus_error)\((?:error, )?'
                       r'"([A-Z_]+)"')
    guard = re.compile(r'"(GUARD_[A-Z]+)"')
    sources = [inspect.getsource(m) for m in (chain, driver, guarding, guarded)]
    named = {name for text in sources for name in calls.findall(text) + guard.findall(text)}
    assert {"COMMAND_INVALID", "PCA_READBACK", "CUT_OFF", "GUARD_SILENT"} <= named
    assert named - {"CAR_MOVES"} <= set(TRIPS)


@pytest.mark.parametrize(("arms", "throttle", "warned"), [
    (False, 0.2, True), (False, 0.0, False), (True, 0.2, False)])
def test_a_program_that_did_not_arm_is_warned_at_its_end(arms, throttle, warned, caplog):
    with caplog.at_level(logging.WARNING, "dart_hal"), Car.open(MOCK_1_URL) as car:
        if arms:
            car.arm()
        for _ in car.states(duration=0.1):
            car.drive(throttle=throttle)
    assert any("did not call car.arm()" in m for m in caplog.messages) is warned


def test_a_command_that_is_refused_disarms_at_once_and_not_with_the_next_frame():
    with Car.open("sim://?nano=mock") as car:
        car.arm()
        for _ in car.states(duration=0.1):
            car.drive(throttle=0.2)
        with pytest.raises(BadCommand):
            car.drive(throttle=float("nan"))
        assert (car.mode, car.causes) == ("TRIPPED", ("COMMAND_INVALID",))
        assert car._engine.driver.applied.throttle == 0.0
