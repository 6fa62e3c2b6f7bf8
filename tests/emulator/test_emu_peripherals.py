"""What the firmware uses of simavr itself: timer pins, capture, watchdog, ADC, interrupts."""

from __future__ import annotations

from itertools import pairwise

import pytest

pytestmark = pytest.mark.emulator


def test_compare_output_drives_d9(nano):
    nano.ask(b"o", 0.0005)
    nano.pin_log()
    nano.drain(nano.now + 0.1)
    edges = [e for e in nano.pin_log() if e.pin == "D9"]
    assert len(edges) == 100
    assert [b.t - a.t for a, b in pairwise(edges)] == pytest.approx([1e-3] * 99, abs=1e-9)
    assert {e.level for e in edges} == {0, 1}


def test_input_capture_stamps_d8_to_half_a_microsecond(nano):
    nano.set_pin("D8", False)
    nano.drain(0.01)
    stamps = []
    for k in range(1, 8):
        nano.drain(0.01 + k * 0.01037)
        nano.set_pin("D8", True)
        stamps.append(int.from_bytes(nano.ask(b"i", 0.005), "little"))
        nano.set_pin("D8", False)
    steps = [(b - a) % 2000 for a, b in pairwise(stamps)]
    assert steps == pytest.approx([20_740 % 2000] * 6, abs=1)  # 10.37 ms in ticks of 0.5 us


def test_watchdog_interrupt_comes_after_16_ms(nano):
    start = nano.now
    nano.write(b"k")
    while not (chunks := nano.read()):
        nano.run(nano.now + 1e-4)
    assert chunks[0][0] == b"K"
    assert chunks[0][1] - start == pytest.approx(0.0161, abs=0.0002)


@pytest.mark.parametrize("volt", [5.0, 4.5])
def test_bandgap_measures_the_supply(nano, volt):
    nano.set_vcc(volt)
    assert int.from_bytes(nano.ask(b"v"), "little") == pytest.approx(1.1 / volt * 1024, abs=2)


def test_no_interrupt_is_lost_under_load(nano):
    """Both rings, the 1 kHz beat and a full receive line at the same time."""
    nano.set_ring(0, [i / 64 for i in range(64)])
    nano.set_ring(1, [i / 64 + 0.0041 for i in range(64)])
    nano.set_wheel(130.0)  # 2 x 8320 edges/s
    nano.write(b"x" * 5000)
    nano.drain(0.101)
    nano.set_wheel(-130.0)
    nano.drain(1.0)
    nano.set_wheel(0.0)
    nano.drain(1.01)
    stats = nano.uart_stats()
    assert stats.received == 5000
    assert stats.overrun == 0
    assert nano.edges(0) > 8000
    assert nano.counts() == (nano.edges(0), nano.edges(1))


def test_marks_time_sections_of_the_program(nano):
    nano.ask(b"t\x00\x02")
    marks = nano.marks()
    assert [v for _, v in marks] == [1, 2, 3, 4, 5, 6, 7, 7]
    assert all(b > a for (a, _), (b, _) in pairwise(marks))
    assert nano.marks() == []
