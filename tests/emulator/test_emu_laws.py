"""Laws that hold for any input: edges counted, buses recovered, images judged."""

from __future__ import annotations

import bisect
import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dart_hal.devices.links.emulator import EmulatedNano
from dart_hal.devices.links.image import FLASH_SIZE, ImageError, parse_elf, parse_hex

RATES = st.lists(st.tuples(st.floats(-80, 80), st.integers(1, 40)), min_size=1, max_size=12)
MARKS = st.lists(st.integers(0, 9999), min_size=2, max_size=24, unique=True).map(
    lambda m: sorted(x / 10_000 for x in m[:len(m) // 2 * 2]))
BUS_FAULTS = st.lists(st.tuples(st.sampled_from(["ok", "nack", "sda", "scl", "dead"]),
                                st.floats(0, 0.01)), max_size=8)
lawful = settings(max_examples=40, deadline=None,
                  suppress_health_check=[HealthCheck.function_scoped_fixture])


def marks_up_to(position, marks):
    turn = math.floor(position)
    return turn * len(marks) + bisect.bisect_right(marks, position - turn)


@pytest.mark.emulator
@lawful
@given(RATES, MARKS)
def test_edges_are_the_marks_that_the_position_has_crossed(probe, rates, marks):
    with EmulatedNano(probe) as nano:
        nano.run(0.001)  # the program powers the sensor
        while nano.run(0.001):
            pass
        nano.set_ring(0, marks)
        start = nano.edges(0)
        position = 0.0
        crossed = 0
        uncertain = 0
        for rate, ticks in rates:
            nano.set_wheel(rate)
            for _ in range(ticks):
                nano.run(nano.now + 0.001)
            after = position + rate * ticks * 0.001
            crossed += abs(marks_up_to(after, marks) - marks_up_to(position, marks))
            position = after
            # a mark that the segment's end touches may fall to either side
            uncertain += 2 * (marks_up_to(after + 1e-6, marks) != marks_up_to(after - 1e-6, marks))
        nano.set_wheel(0.0)
        nano.run(nano.now + 0.001)
        assert abs(nano.edges(0) - start - crossed) <= uncertain


@pytest.mark.emulator
@lawful
@given(BUS_FAULTS)
def test_the_bus_always_comes_back(probe, faults):
    with EmulatedNano(probe) as nano:
        nano.run(0.5)
        while nano.run(0.5):
            pass
        nano.read()
        nano.write(b"t\x00\x04t\x14\x06")
        for fault, seconds in faults:
            nano.set_i2c(fault, p=0.5)
            until = nano.now + seconds
            while nano.run(until):
                pass
        nano.set_i2c("ok")
        until = nano.now + 1.0  # each step of the program gives up after some 10 ms
        while nano.run(until):
            pass
        nano.read()
        nano.write(b"g\x00t\x00\x01")  # TWI off and on
        until = nano.now + 0.05
        while nano.run(until):
            pass
        answer = b"".join(data for data, _ in nano.read())
        assert answer == bytes([1, 0x08, 0x18, 0x28, 0x10, 0x40, 0x58, 0xA0])


@lawful
@given(st.binary(max_size=300))
def test_any_bytes_are_an_image_or_an_image_error(blob):
    head = b"\x7fELF\x01\x01" + bytes(10) + b"\x02\x00\x53\x00"
    for parse, given_ in ((parse_elf, blob), (parse_elf, head + blob),
                          (parse_hex, ":" + blob.hex()), (parse_hex, blob.decode("latin-1"))):
        try:
            flash = parse(given_)
        except ImageError:
            continue
        assert 0 < len(flash) <= FLASH_SIZE
