"""D9 as compare output: what the data sheet states of the port, the mode bits and the latch.

"The general I/O port function is overridden by the Output Compare (OC1x) ... if either of
the COM1x1:0 bits are set"; "if a system reset occurs, the OC1x Register is reset to zero".
"""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.emulator

PORTB = 0x25
DDRB = 0x24
TCCR1A = 0x80
TCCR1C = 0x82
OCR1AL = 0x88
OCR1AH = 0x89
MATCH = 11
"""Vector of TIMER1_COMPA."""
TOGGLE = 0x40
CLEAR = 0x80
SET = 0xC0
FORCE = 0x80


@pytest.fixture
def pin(nano):
    """D9 as output; ``pin.write(register, value)``, ``pin.level()``."""

    class Pin:
        def write(self, register, value):
            nano.ask(bytes((ord("r"), register, value)), 0.0003)
            return self

        def level(self):
            return nano.pins()["D9"]

        def beat(self):
            """To just behind the next match; they come each 33 ms."""
            before = nano.isr(MATCH).n
            while nano.isr(MATCH).n == before:
                nano.drain(nano.now + 1e-4)
            return self

    return Pin().write(OCR1AH, 0xFF).write(OCR1AL, 0xFF).write(DDRB, 0x02).beat()


def test_a_write_to_the_port_does_not_end_a_pulse(pin):
    """A state LED on the same port once cut the own neutral pulse, in the model only."""
    pin.write(TCCR1A, SET).beat()
    assert pin.level() == 1
    pin.write(PORTB, 0x20).write(PORTB, 0x00)
    assert pin.level() == 1
    pin.write(TCCR1A, CLEAR)
    assert pin.level() == 1  # until the match
    pin.beat()
    assert pin.level() == 0


def test_without_mode_bits_the_port_decides(pin):
    """The control: the port drives the pin as soon as COM1A is 0."""
    pin.write(TCCR1A, SET).beat().write(TCCR1A, 0)
    assert pin.level() == 0
    assert pin.write(PORTB, 0x02).level() == 1


def test_the_latch_outlives_its_disconnection(pin):
    pin.write(TCCR1A, SET).beat().write(TCCR1A, 0)
    assert pin.level() == 0
    assert pin.write(TCCR1A, CLEAR).level() == 1
    pin.write(TCCR1A, 0).beat()  # a match while disconnected changes nothing
    assert pin.write(TCCR1A, CLEAR).level() == 1


def test_force_acts_at_once(pin):
    pin.write(TCCR1A, SET).write(TCCR1C, FORCE)
    assert pin.level() == 1
    pin.write(TCCR1A, TOGGLE).write(TCCR1C, FORCE)
    assert pin.level() == 0


def test_the_direction_stays_with_ddr(pin):
    pin.write(TCCR1A, SET).beat().write(DDRB, 0)
    assert pin.level() is None


def test_a_reset_clears_the_latch(pin, nano):
    pin.write(TCCR1A, SET).beat()
    nano.reset()
    nano.drain(nano.now + 0.001)
    assert pin.write(DDRB, 0x02).write(TCCR1A, CLEAR).level() == 0
