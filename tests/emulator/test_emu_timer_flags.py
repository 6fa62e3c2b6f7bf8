"""Interrupt flags of Timer1: "can be cleared by writing a logic one to its bit location"."""

from __future__ import annotations

import pytest

from dart_hal import Car

pytestmark = pytest.mark.emulator

TIFR1 = 0x36
OCR1BH = 0x8B
ICF1 = 0x20
OCF1B = 0x04


@pytest.fixture
def flags(nano):
    """``flags.read()``, ``flags.write(value)``; OCF1B is set once, its interrupt off."""

    class Flags:
        def read(self):
            return nano.ask(bytes((ord("s"), TIFR1)), 0.0003)[-1]

        def write(self, value):
            nano.ask(bytes((ord("r"), TIFR1, value)), 0.0003)
            return self

    nano.drain(nano.now + 0.003)  # OCR1B = 0: a match each millisecond
    nano.ask(bytes((ord("r"), OCR1BH, 0xFF)), 0.0003)  # no more of them
    return Flags()


def test_a_flag_is_cleared_by_its_own_bit_alone(flags):
    assert flags.read() & OCF1B
    assert flags.write(ICF1).read() & OCF1B
    assert not flags.write(OCF1B).read() & OCF1B


@pytest.mark.slow
def test_captures_lose_no_time(firmware):
    """A thousand edges at D8, some of which come with an overflow of the timer: time goes on."""
    with Car.open("sim://?seed=11&nano=avr") as car:
        with car.raw():
            car.clock_pulse(True)
            for k, state in enumerate(car.states(duration=12.0)):
                if k % 600 == 0:
                    car.request("CAPTURE_REQ", frames=250)
                car.pulses(steering_us=1500.0, throttle_us=1500.0)
        assert state.t > 11.9
        assert car.timing.lost == 0
