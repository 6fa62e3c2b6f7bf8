"""Encoder rings: counts are exact, at any rate, direction and mark pattern."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.devices.links.emulator import EmulatedNano

pytestmark = pytest.mark.emulator

EVEN = [i / 20 for i in range(20)]
"""Marks of an even ring with 20 edges per revolution."""


def spin(nano, rate, seconds, tick=0.001):
    """Turn for ``seconds``, updated once per tick as the physics does."""
    start = nano.now
    for k in range(1, round(seconds / tick) + 1):
        nano.set_wheel(rate)
        nano.drain(start + k * tick)
    nano.set_wheel(0)


@pytest.mark.parametrize("edges_per_s", [200, 2422, 10_000, 40_000])
def test_every_edge_is_counted_once(nano, edges_per_s):
    nano.set_ring(0, EVEN)
    spin(nano, edges_per_s / 20, 0.5)
    expected = edges_per_s // 2
    assert nano.edges(0) == pytest.approx(expected, abs=1)
    assert nano.counts()[0] == nano.edges(0) % 65536


def test_two_rings_at_once(nano):
    nano.set_ring(0, EVEN)
    nano.set_ring(1, [i / 10 + 0.013 for i in range(10)])
    spin(nano, 150, 1.0)
    assert nano.counts() == (nano.edges(0), nano.edges(1))
    assert nano.edges(0) == pytest.approx(3000, abs=1)
    assert nano.edges(1) == pytest.approx(1500, abs=1)


def test_edges_fall_on_the_cycle_of_the_mark(nano):
    nano.set_ring(0, [0.25, 0.5])
    start = nano.cycle
    nano.set_wheel(100.0)  # a revolution in 160000 cycles
    for n, cycle in enumerate([40_000, 80_000, 200_000, 240_000, 16_040_000]):
        edges = nano.edges(0)
        nano.drain((start + cycle - 1) / 16e6)
        before = nano.edges(0)
        nano.drain((start + cycle + 12) / 16e6)  # an instruction or an interrupt entry later
        assert nano.edges(0) == before + 1
        assert n == 4 or before == edges


def test_missing_mark_is_simply_absent(nano):
    full = EVEN
    nano.set_ring(0, full)
    nano.set_ring(1, full[:8] + full[10:])  # one tooth broken off
    spin(nano, 10, 1.0)
    a, b = nano.counts()
    assert a == pytest.approx(200, abs=1)
    assert b == pytest.approx(180, abs=1)


def test_slow_and_stopped(nano):
    nano.set_ring(0, EVEN)
    spin(nano, 0.1, 1.0)  # a tenth of a revolution
    assert nano.edges(0) == pytest.approx(2, abs=1)
    before = nano.edges(0)
    nano.drain(nano.now + 2.0)
    assert nano.edges(0) == before


def test_reverse_passes_the_same_marks(nano):
    nano.set_ring(0, EVEN)
    spin(nano, 33.3, 0.2)
    forth = nano.edges(0)
    spin(nano, -33.3, 0.2)
    assert nano.edges(0) == 2 * forth
    assert nano.counts()[0] == 2 * forth


def test_jitter_about_a_mark_makes_pairs(nano):
    nano.set_ring(0, [0.1, 0.6])
    for _ in range(10):  # +-0.09 rev about 0.1, begun at 0
        spin(nano, 20, 0.0095, tick=0.0095)
        spin(nano, -20, 0.0095, tick=0.0095)
    assert nano.edges(0) == 20
    assert nano.counts()[0] == 20


def test_phase_is_continuous_over_rate_changes(make_nano):
    fine = make_nano()
    coarse = make_nano()
    for nano in (fine, coarse):
        nano.set_ring(0, EVEN)
    rates = [7.0, 91.3, -40.0, 12.5]
    for k, rate in enumerate(rates):
        spin(coarse, rate, 0.1, tick=0.1)
        spin(fine, rate, 0.1, tick=0.001)
        assert fine.edges(0) == coarse.edges(0), k


def test_an_unpowered_infrared_sensor_sees_nothing(emulator):
    with EmulatedNano(bytes.fromhex("ffcf")) as idle:  # rjmp .-2: D7 floats
        for ring in (0, 1):
            idle.set_ring(ring, [0.1, 0.6])
        idle.set_wheel(100)
        idle.run(1.0)
        assert idle.edges(0) == 0
        assert idle.edges(1) == 200  # the Hall sensor has a supply of its own


def test_bad_rings_are_refused(nano):
    for marks in ([0.1], [0.2, 0.1], [0.5, 1.0], [0.3, 0.3], [float("nan"), 0.5]):
        with pytest.raises(UsageError):
            nano.set_ring(0, marks)
    with pytest.raises(UsageError):
        nano.set_ring(2, EVEN)
