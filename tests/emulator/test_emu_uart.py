"""The line: stop-bit stamps, stop at delimiters, pacing, overrun, rate mismatch."""

from __future__ import annotations

from itertools import pairwise

import pytest

from dart_hal.devices.links.emulator import EmulatedNano

pytestmark = pytest.mark.emulator
BYTE_S = 10 / 500_000
"""Time of one byte at 500000 baud [s]."""


def test_run_stops_at_the_stop_bit_of_a_delimiter(probe, make_nano):
    with EmulatedNano(probe) as nano:
        assert nano.run(0.01) is True
        assert 0 < nano.now < 0.001
        (chunk, t), = nano.read()
        assert chunk == b"B\x01\x00"  # power-on flag
        assert t == nano.now
        assert nano.run(0.01) is False
        assert nano.now == 0.01


def test_bytes_of_a_burst_are_spaced_by_ten_bits(nano):
    nano.write(b"xyxyxyxy")
    stamps = []
    for k in range(1, 400):
        nano.run(0.001 + k * 1e-6)
        stamps += [t for data, t in nano.read() for _ in data]
    gaps = [b - a for a, b in pairwise(stamps)]
    assert len(stamps) == 8
    assert gaps == pytest.approx([BYTE_S] * 7, abs=2e-6)
    assert min(gaps) >= BYTE_S - 1e-9  # never faster than the line


def test_back_to_back_bytes_use_the_whole_line(nano):
    answer = bytearray()
    stamps = []
    nano.write(b"t\x00\x20")  # polled output between I2C bytes is slower than the line
    nano.write(b"xyz")
    nano.drain(nano.now + 0.02)
    nano.write(b"c")  # five bytes in a row from a polling loop
    start = nano.now
    for k in range(1, 300):
        while nano.run(start + k * 1e-6):
            pass
        for data, t in nano.read():
            answer += data
            stamps += [t] * len(data)
    assert bytes(answer)[:1] == b"C"
    assert stamps[-1] - stamps[0] == pytest.approx(4 * BYTE_S, abs=2e-6)


def test_a_byte_is_held_back_until_its_stop_bit(nano):
    nano.write(b"x")
    nano.run(0.001 + 1.5 * BYTE_S)  # echoed, on the line, not complete
    assert nano.read() == []
    nano.run(0.001 + 3 * BYTE_S)
    assert [data for data, _ in nano.read()] == [b"x"]


def test_echo_of_2000_bytes_is_complete(nano):
    commands = bytes.maketrans(b"ctWgbdwep", b"z" * 9)
    sent = bytes(33 + i % 60 for i in range(2000)).translate(commands)
    assert nano.ask(sent, 0.06) == sent
    assert nano.uart_stats().overrun == 0


def test_host_bytes_arrive_one_per_ten_bits(nano):
    nano.write(bytes(100))
    nano.drain(0.001 + 50.5 * BYTE_S)
    assert nano.uart_stats().received == 50
    nano.drain(0.001 + 100.5 * BYTE_S)
    assert nano.uart_stats().received == 100


def test_third_unread_byte_is_lost_and_shown(nano):
    answer = nano.ask(b"dABCD", 0.01)
    assert answer[:2] == bytes([2, 8])  # two were kept, DOR was set
    assert nano.uart_stats().overrun == 2


@pytest.mark.parametrize("rate", [500_000 * 1.035, 500_000 * 0.965])
def test_small_rate_error_is_tolerated(make_nano, rate):
    nano = make_nano(host_baud=rate)
    assert nano.ask(b"xyz") == b"xyz"
    assert nano.uart_stats().garbled == 0


@pytest.mark.parametrize("rate", [115_200, 500_000 * 1.05])
def test_rate_mismatch_garbles_both_ways(make_nano, rate):
    nano = make_nano(host_baud=rate)
    before = nano.uart_stats().garbled
    assert before >= 3  # the boot message did not survive
    assert nano.ask(b"x" * 50) != b"x" * 50
    assert nano.uart_stats().garbled > before
    nano.set_baud(500_000)
    nano.drain(nano.now + 0.1)
    assert nano.ask(b"xx")[-2:] == b"xx"


def test_clock_error_stretches_the_bytes(make_nano):
    slow = make_nano(clock_error=-0.005)
    true = make_nano()
    assert slow.uart_stats().baud == pytest.approx(500_000 * 0.995)
    for nano in (slow, true):
        nano.drain(1.0)
    assert slow.cycle / true.cycle == pytest.approx(0.995, abs=1e-6)
