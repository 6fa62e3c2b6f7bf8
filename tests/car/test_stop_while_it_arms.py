"""A stop while ``arm()`` or ``raw()`` waits ends that call: the ESC's pin stays at neutral."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.car.driver import Driver
from dart_hal.core.errors import DartHalError, NotArmed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from tests.common import MOCK_URL, NEUTRAL_TOLERANCE_US, NEUTRAL_US

STOP_HELD_S = 0.5


def arm_and_drive(car):
    car.arm()
    for _ in car.states(duration=0.5):
        car.drive(throttle=0.3)


def drive_raw(car):
    with car.raw():
        for _ in car.states(duration=0.5):
            car.pulses(steering_us=1500.0, throttle_us=1620.0)


def call_stop(car, pressed):
    if pressed:
        car.stop()


def press_run_stop(car, pressed):
    """As STOP at a page or in a room: held for half a second."""
    car.run_stop(pressed, source="judge", reason="a person is on the track")


def stop_during(program, stop, delay):
    """Run a program that is stopped once; return (its error or None, widths [us] of pulses)."""
    backend = open_backend(MOCK_URL)
    world = world_of(backend)
    widths = []
    world.watchers.append(
        lambda channel, pulse: widths.append((pulse[1] - pulse[0]) * 1e6) if channel == 1 else None)
    with Car.over(backend) as car:
        events = [(world.t + delay, True), (world.t + delay + STOP_HELD_S, False)]

        def press_when_due(state):
            if events and world.t >= events[0][0]:
                stop(car, events.pop(0)[1])

        car.on_state(press_when_due)
        try:
            program(car)
        except DartHalError as error:
            return error, widths
        return None, widths


def moves(widths):
    return max(abs(width - NEUTRAL_US) for width in widths) > NEUTRAL_TOLERANCE_US


@pytest.mark.parametrize("stop", [call_stop, press_run_stop])
@pytest.mark.parametrize("program", [arm_and_drive, drive_raw])
@pytest.mark.parametrize("delay", [0.01, 0.2, 1.5])
def test_a_stopped_call_raises_with_the_reason_and_nothing_moves(program, stop, delay):
    error, widths = stop_during(program, stop, delay)
    assert widths
    assert not moves(widths)
    assert isinstance(error, NotArmed)
    assert error.reasons == ("RUN_STOP",)
    assert ("person" if stop is press_run_stop else "stop() was called") in str(error)


@pytest.mark.parametrize("program", [arm_and_drive, drive_raw])
def test_control_a_forgotten_stop_lets_the_car_drive(program, monkeypatch):
    monkeypatch.setattr(Driver, "refuse_if_stopped", lambda driver, stops: None)
    assert moves(stop_during(program, call_stop, 0.01)[1])


def test_a_stop_before_the_call_does_not_count():
    with Car.open(MOCK_URL) as car:
        car.stop()
        car.run_stop(True, source="judge")
        car.run_stop(False, source="judge")
        car.arm()
        assert car.mode == "ARMED"


def test_a_run_stop_that_is_pressed_again_while_it_is_held_counts():
    """As a second STOP at a page within the half second of the first."""
    with Car.open(MOCK_URL) as car:
        car.run_stop(True, source="judge")
        steps = car.arming()
        next(steps)
        car.run_stop(True, source="judge")
        car.run_stop(False, source="judge")
        with pytest.raises(NotArmed):
            list(steps)
        assert car.mode == "DISARMED"


def test_one_waived_check_may_be_a_string():
    with Car.open("sim://?nano=mock", car="new") as car:
        car.arm(waive="CALIBRATION_MISSING")
        assert car.mode == "ARMED"


def test_arm_of_an_armed_car_that_drives_changes_nothing():
    with Car.open(MOCK_URL) as car:
        car.arm()
        for _ in car.states(duration=0.3):
            car.arm()
            applied = car.drive(throttle=0.3)
        assert (car.mode, applied.throttle > 0.1) == ("ARMED", True)
