"""Resets and their causes, EEPROM, hang, crash, pins, probes."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import LinkLost, UsageError
from dart_hal.devices.links.emulator import EmulatedNano

pytestmark = pytest.mark.emulator


@pytest.mark.parametrize(("cause", "flag"), [
    ("external", 2), ("power", 1), ("brownout", 4), ("watchdog", 8)])
def test_the_program_sees_the_cause(nano, cause, flag):
    nano.reset(cause)
    assert nano.drain(nano.now + 0.002) == bytes([ord("B"), flag, 0])


def test_unknown_cause_is_refused(nano):
    with pytest.raises(UsageError):
        nano.reset("cosmic ray")


def test_the_watchdog_really_bites(nano):
    start = nano.now
    assert nano.ask(b"w", 0.1) == b"B\x08\x00"
    assert nano.now - start == pytest.approx(0.1)


def test_time_and_inputs_go_on_through_a_reset(nano):
    nano.set_ring(0, [i / 20 for i in range(20)])
    nano.set_wheel(50)
    nano.drain(0.1)
    cycle = nano.cycle
    edges = nano.edges(0)
    nano.reset()
    nano.drain(0.2)
    assert nano.cycle - cycle == 1_600_000
    assert nano.edges(0) - edges == pytest.approx(100, abs=2)
    assert nano.counts()[0] == pytest.approx(nano.edges(0) - edges, abs=3)


def test_a_byte_under_way_is_cut_off(nano):
    nano.write(b"xxxx")
    nano.drain(0.001 + 50e-6)
    nano.read()
    nano.reset()
    assert nano.drain(nano.now + 0.01).startswith(b"B\x02\x00")


def test_eeprom_survives_resets_and_is_the_callers(probe, make_nano):
    nano = make_nano(eeprom=b"\x07" + bytes(10))
    assert nano.ask(b"e") == b"\x07"
    nano.reset("power")
    nano.drain(nano.now + 0.01)
    assert nano.ask(b"e") == b"\x08"
    assert nano.eeprom[0] == 9
    assert len(nano.eeprom) == 1024
    with pytest.raises(UsageError):
        nano.eeprom = bytes(1025)


def test_eeprom_write_takes_3_4_ms(nano):
    nano.write(b"ee")  # the second has to wait for the first
    assert nano.drain(nano.now + 0.0033) == b"\xff"
    assert nano.drain(nano.now + 0.0010) == b"\x00"


def test_ram_survives_an_external_reset_but_not_a_power_cycle(nano):
    nano.poke(0x700, 0x42)
    nano.reset("external")
    assert nano.peek(0x700) == 0x42
    nano.reset("power")
    assert nano.peek(0x700) != 0x42


def test_hang_stops_the_main_program_but_not_interrupts(nano):
    nano.set_ring(0, [i / 20 for i in range(20)])
    nano.hang()
    nano.set_wheel(1000)  # thousands of interrupts must not carry it on
    assert nano.ask(b"xyz", 0.5) == b""
    nano.hang(False)
    assert nano.drain(nano.now + 0.01) == b"xyz"
    nano.set_wheel(0)
    assert nano.counts()[0] == nano.edges(0)
    assert nano.edges(0) > 9000


def test_a_crashed_program_is_silent_until_a_reset(emulator):
    wild = bytes.fromhex("0fef0000")  # then off into blank flash
    with EmulatedNano(wild) as nano:
        assert nano.run(0.5) is False
        assert nano.crashed
        assert nano.read() == []
        assert nano.now == 0.5  # time goes on
        nano.reset()
        assert not nano.crashed


def test_a_closed_nano_is_an_error(probe):
    nano = EmulatedNano(probe)
    nano.close()
    nano.close()
    with pytest.raises(LinkLost):
        nano.run(1.0)
    with pytest.raises(LinkLost):
        nano.write(b"x")


def test_pins_and_their_log(nano):
    assert nano.pins()["D4"] == 1
    assert nano.pins()["D6"] is None
    nano.pin_log()
    t = nano.now
    nano.ask(b"p", 0.01)
    nano.ask(b"p", 0.01)
    log = [(e.pin, e.level) for e in nano.pin_log()]
    assert log == [("D4", 0), ("D4", 1)]
    nano.ask(b"p", 0.01)
    (edge,) = nano.pin_log()
    assert t + 0.02 < edge.t < t + 0.021
    nano.reset()
    assert ("D7", None) in [(e.pin, e.level) for e in nano.pin_log()]


def test_interrupts_are_measured_with_entry_and_return(nano):
    nano.set_ring(0, [i / 20 for i in range(20)])
    nano.set_wheel(50)
    nano.drain(0.5)
    nano.set_wheel(0)
    nano.drain(0.501)
    stat = nano.isr(1)
    assert stat.n == nano.edges(0)
    assert stat.max - stat.min == 4  # some edges found it asleep
    assert 52 <= stat.min <= 56  # counted by hand: 4 of entry, 46 from jmp to pop, 4 of reti
    assert stat.min * stat.n <= stat.total <= stat.max * stat.n
    assert nano.isr(2).n == 0


def test_stack_depth_grows_with_use(nano):
    used, free = nano.stack()
    assert 2 <= used < 100
    assert free > 1500
    nano.ask(b"t\x00\x04")
    assert nano.stack()[0] >= used
