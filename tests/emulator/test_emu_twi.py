"""TWI: time by TWBR and stretch, status codes, held lines and their recovery."""

from __future__ import annotations

from itertools import pairwise

import pytest

pytestmark = pytest.mark.emulator
POLL = 16
"""Granularity of the test program's polling [cycles]."""

READ_ID = b"t\x00\x01"
GOOD_STATUS = bytes([0x08, 0x18, 0x28, 0x10, 0x40, 0x58, 0xA0])


@pytest.fixture
def bus(nano):
    """A Nano whose BNO055 has booted."""
    nano.drain(0.5)
    nano.marks()
    return nano


def steps(nano, request=READ_ID):
    """Cycles of each marked step of a read: START, SLA+W, register, START, SLA+R, data."""
    answer = nano.ask(request)
    cycles = [cycle for cycle, _ in nano.marks()]
    return answer, [b - a for a, b in pairwise(cycles)]


def test_a_read_walks_through_the_status_codes(bus):
    assert bus.ask(READ_ID) == GOOD_STATUS


@pytest.mark.parametrize(("twbr", "period"), [(12, 40), (72, 160), (32, 80)])
def test_steps_take_their_scl_periods(bus, twbr, period):
    bus.set_i2c("ok", stretch_us=0)
    bus.ask(bytes([ord("b"), twbr]))
    _, took = steps(bus)
    overhead = 60  # the program around the wait
    assert took[0] - period == pytest.approx(overhead - 25, abs=25)
    for step in (1, 2, 4, 5):
        assert took[step] - 9 * period == pytest.approx(overhead - 25, abs=25)


def test_twbr_changes_times_by_exact_periods(bus):
    bus.set_i2c("ok", stretch_us=0)
    _, fast = steps(bus)
    bus.ask(b"b\x48")
    _, slow = steps(bus)
    for step in (1, 2, 4, 5):
        assert slow[step] - fast[step] == pytest.approx(9 * 2 * (72 - 12), abs=POLL)


@pytest.mark.parametrize("stretch_us", [50, 180, 500])
def test_stretch_adds_to_each_byte(bus, stretch_us):
    bus.set_i2c("ok", stretch_us=0)
    _, plain = steps(bus)
    bus.set_i2c("ok", stretch_us=stretch_us)
    _, slow = steps(bus)
    assert slow[0] - plain[0] == pytest.approx(0, abs=POLL)  # START is not stretched
    for step in (1, 2, 4, 5):
        assert slow[step] - plain[step] == pytest.approx(16 * stretch_us, abs=POLL)


def test_default_stretch_is_180_us(bus):
    _, took = steps(bus)
    assert took[1] == pytest.approx(9 * 40 + 2880 + 35, abs=25)


def test_no_acknowledge_is_0x20_for_a_missing_part(bus):
    bus.set_i2c("nack")
    assert bus.ask(READ_ID)[:2] == b"\x08\x20"
    bus.set_i2c("ok")
    bus.drain(bus.now + 0.05)
    assert bus.ask(READ_ID) == GOOD_STATUS


def test_nack_with_a_probability(bus):
    bus.set_i2c("nack", p=0.3, stretch_us=0)
    first = [bus.ask(READ_ID, 0.01)[1] for _ in range(200)]
    assert set(first) == {0x18, 0x20}
    assert 35 < first.count(0x20) < 85


def test_dead_bus_reads_ones(bus):
    bus.set_i2c("dead")
    answer = bus.ask(READ_ID)
    assert answer[1] == 0x20
    assert answer[-1] == 0xFF


@pytest.mark.parametrize("line", ["sda", "scl"])
def test_a_held_line_stops_the_start(bus, line):
    bus.set_i2c(line, clocks=0)
    assert bus.ask(READ_ID, 0.3)[0] == 0xFE  # TWINT never came
    bus.set_i2c("ok")
    bus.drain(bus.now + 0.3)
    bus.ask(b"g\x00")  # TWI off: forget the half transfer
    assert bus.ask(READ_ID) == GOOD_STATUS


def test_nine_clocks_free_sda(bus):
    bus.set_i2c("sda", clocks=9)
    assert bus.ask(b"g\x05") == b"\x00"
    assert bus.ask(b"g\x03") == b"\x00"
    assert bus.ask(b"g\x01") == b"\x01"
    assert bus.ask(READ_ID) == GOOD_STATUS


def test_clocks_do_not_free_a_short(bus):
    bus.set_i2c("sda", clocks=0)
    assert bus.ask(b"g\x20") == b"\x00"


def test_a_waiting_start_goes_on_when_the_line_is_free(bus):
    bus.set_i2c("scl")
    bus.write(READ_ID)
    bus.drain(bus.now + 0.003)
    bus.set_i2c("ok")
    assert bus.drain(bus.now + 0.05) == GOOD_STATUS


def test_the_part_is_powered_by_d4(bus):
    bus.ask(b"p")  # D4 low
    assert bus.pins()["D4"] == 0
    assert bus.ask(READ_ID)[1] == 0x20
    bus.ask(b"p")
    assert bus.ask(READ_ID, 0.1)[1] == 0x20  # boots 400 ms
    bus.drain(bus.now + 0.3)
    assert bus.ask(READ_ID) == GOOD_STATUS
