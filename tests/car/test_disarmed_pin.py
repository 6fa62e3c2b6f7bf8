"""A program that goes on commanding a car that tripped: the ESC's pin stays at neutral."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import Disarmed
from dart_hal.devices.actuation import ArmState
from dart_hal.devices.actuation.states import ENTRY
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

PULSE_AFTER_COMMAND_S = 0.040  # s: the PWM frame under way and the next, as for every command
COMMAND_VALID_S = 0.2  # s


def driven_on(again=False):
    """Of a program that drives on: (pulses [us] at the ESC since its command expired, throttles
    of States since, number of commands refused). again: it arms once more.
    """
    backend = open_backend("sim://?nano=mock")
    pulses = []
    applied = []
    refused = 0
    world = world_of(backend)
    world.watchers.append(lambda channel, pulse: pulses.append(pulse) if channel == 1 else None)
    with Car.over(backend) as car:
        car.arm()
        car.on_state(lambda state: applied.append((world.t, state.applied.throttle)))
        car.drive(throttle=0.2, valid_for=COMMAND_VALID_S)
        expired = world.t + COMMAND_VALID_S + PULSE_AFTER_COMMAND_S
        for _ in car.states(duration=0.4):
            pass
        assert car.causes == ("COMMAND_EXPIRED",)
        if again:
            car.arm()
        for _ in car.states(duration=0.6):
            try:
                car.drive(throttle=0.3)
            except Disarmed:
                refused += 1
        ends = world.t
    widths = [(fall - rise) * 1e6 for rise, fall in pulses if expired < fall < ends]
    throttles = [throttle for t, throttle in applied if t > expired]
    return widths, throttles, refused


def stays_neutral(widths, throttles):
    assert widths
    assert max(abs(width - NEUTRAL_US) for width in widths) <= NEUTRAL_TOLERANCE_US
    assert set(throttles) == {0.0}


def test_every_pulse_after_the_trip_is_neutral_and_every_command_refused():
    widths, throttles, refused = driven_on()
    stays_neutral(widths, throttles)
    assert refused >= 55


def test_a_program_that_arms_again_drives():
    """Control: the pin is observed."""
    widths, throttles, refused = driven_on(again=True)
    assert refused == 0
    with pytest.raises(AssertionError):
        stays_neutral(widths, throttles)


def test_a_trip_that_leaves_the_throttle_alive_is_detected(monkeypatch):
    """Control: broken code."""
    for state in (ArmState.TRIPPED, ArmState.DISARMED):
        monkeypatch.setitem(ENTRY, state, ENTRY[ArmState.ARMED])
    monkeypatch.setattr(Car, "_refuse_if_disarmed", lambda self: None)
    widths, throttles, _ = driven_on()
    with pytest.raises(AssertionError):
        stays_neutral(widths, throttles)
