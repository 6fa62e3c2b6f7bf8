"""Faults that the bridge can put into the emulated Nano, each at the pin or register it acts on."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import UsageError

pytestmark = pytest.mark.emulator

INT0 = 1
INT1 = 2


# --- chatter on the encoder wires


@pytest.mark.parametrize("rate", [1e3, 1e5, 1e6])
def test_chatter_is_edges_at_the_pin(nano, rate):
    nano.drain(0.01)
    nano.set_chatter(0, rate)
    nano.drain(0.02)
    assert nano.edges(0) == pytest.approx(0.01 * rate, abs=2)
    served = nano.isr(INT0).n
    if rate < 1e6:
        assert served == pytest.approx(nano.edges(0), abs=1)
    else:  # an interrupt of some 50 cycles: many edges fall into one
        assert 0.01 * 16e6 / 90 < served < 0.01 * 16e6 / 40


def test_chatter_starves_the_program_and_its_end_heals(nano):
    nano.set_chatter(0, 1e6)
    assert nano.ask(b"xyz", 0.05) != b"xyz"
    nano.set_chatter(0, 0)
    nano.drain(nano.now + 0.01)
    assert nano.ask(b"a", 0.01) == b"a"
    before = nano.edges(0)
    nano.drain(nano.now + 0.1)
    assert nano.edges(0) == before
    assert before % 2 == 0  # the level is the sensor's again


def test_noise_at_random_has_its_rate_and_no_rhythm(nano):
    nano.set_chatter(1, 2000.0, irregular=True)
    nano.drain(1.001)
    assert nano.edges(1) == pytest.approx(2000, rel=0.1)
    assert nano.edges(0) == 0
    assert nano.isr(INT1).n == pytest.approx(nano.edges(1), rel=0.1)


def test_noise_comes_on_top_of_the_wheel(nano):
    nano.set_ring(0, [k / 20 for k in range(20)])
    nano.set_wheel(10.0)
    nano.set_chatter(0, 300.0, irregular=True)
    nano.drain(1.001)
    assert nano.edges(0) == pytest.approx(500, abs=60)


def test_chatter_faster_than_the_model_is_refused(nano):
    with pytest.raises(UsageError):
        nano.set_chatter(0, 3e6)


# --- supply


def test_without_power_nothing_is_driven_and_nothing_is_sent(nano):
    nano.ask(b"p", 0.001)
    nano.set_power(False)
    assert set(nano.pins().values()) == {None}
    assert nano.ask(b"xyz", 0.5) == b""
    nano.reset("external")  # the button of a dead board
    assert nano.drain(nano.now + 0.1) == b""
    nano.poke(0x700, 0x42)
    nano.set_power(True)
    assert nano.drain(nano.now + 0.01) == b"B\x01\x00"
    assert nano.peek(0x700) != 0x42
    assert nano.ask(b"t\x00\x01", 0.01)[1] == 0x20  # the BNO055 lost its supply too
    nano.drain(nano.now + 0.5)
    assert nano.ask(b"t\x00\x01", 0.01)[1] == 0x18


def test_a_droop_is_measured_by_the_adc_and_below_2_7_v_resets(nano):
    nano.set_vcc(3.0)
    assert int.from_bytes(nano.ask(b"v"), "little") == pytest.approx(1.1 / 3.0 * 1024, abs=2)
    nano.set_vcc(2.6)
    assert set(nano.pins().values()) == {None}
    assert nano.ask(b"xyz", 0.5) == b""
    nano.set_vcc(2.72)  # hysteresis
    assert nano.drain(nano.now + 0.1) == b""
    nano.set_vcc(5.0)
    assert nano.drain(nano.now + 0.01) == b"B\x04\x00"


# --- EEPROM


def write_begun(nano):
    """An EEPROM write of the byte 0 that began just now: 7 becomes 8."""
    nano.write(b"e")
    nano.drain(nano.now + 0.0005)


def test_a_supply_that_fails_tears_the_byte_under_way(make_nano):
    nano = make_nano(eeprom=b"\x07\x55")
    write_begun(nano)
    nano.reset("brownout")
    assert nano.eeprom[0] not in (7, 8)
    assert nano.eeprom[1] == 0x55


@pytest.mark.parametrize("cause", ["external", "watchdog"])
def test_any_other_reset_lets_the_write_end(make_nano, cause):
    """The control: the data sheet reports that while the supply holds."""
    nano = make_nano(eeprom=b"\x07")
    write_begun(nano)
    nano.reset(cause)
    assert nano.eeprom[0] == 8


def test_the_nth_write_is_torn_and_resets(make_nano):
    nano = make_nano(eeprom=b"\x07")
    nano.tear_eeprom(2)
    assert nano.ask(b"e", 0.01) == b"\x07"
    assert nano.eeprom[0] == 8
    assert nano.ask(b"e", 0.01) == b"\x08B\x04\x00"
    assert nano.eeprom[0] not in (8, 9)
    torn = nano.eeprom[0]
    nano.ask(b"e", 0.01)
    assert nano.eeprom[0] == (torn + 1) & 0xFF


def test_a_tear_that_was_called_off(make_nano):
    nano = make_nano(eeprom=b"\x07")
    nano.tear_eeprom(1)
    nano.tear_eeprom(0)
    nano.ask(b"e", 0.01)
    assert nano.eeprom[0] == 8


# --- at rest


def test_a_freeze_stops_interrupts_as_well_and_heals(nano):
    nano.set_ring(0, [k / 20 for k in range(20)])
    nano.ask(b"o", 0.001)
    nano.freeze()
    served = nano.isr(INT0).n
    nano.set_wheel(100)
    nano.pin_log()
    assert nano.ask(b"q", 0.1) == b""
    assert nano.isr(INT0).n == served
    assert len([e for e in nano.pin_log() if e.pin == "D9"]) == 100  # the timer goes on
    nano.freeze(False)
    assert nano.drain(nano.now + 0.01) == b"q"
    assert nano.isr(INT0).n > served


def test_a_hang_by_contrast_serves_them(nano):
    nano.set_ring(0, [k / 20 for k in range(20)])
    nano.hang()
    nano.set_wheel(100)
    nano.drain(nano.now + 0.1)
    assert nano.isr(INT0).n > 190


def test_a_reset_ends_a_freeze(nano):
    nano.freeze()
    nano.reset()
    assert nano.drain(nano.now + 0.01) == b"B\x02\x00"
