"""Encoder rings, and MockNano's counting of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_lab.sim.mock_encoder import MockEncoder
from dart_lab.sim.ring import double_ring, even_ring, uneven_ring, wear_ring


def ticks(t):
    return int(t * 2e6)


def test_even_ring():
    ring = even_ring(20)
    assert ring.n == 20
    assert ring.fractions == pytest.approx([1.0] * 20)


@given(seed=st.integers(0, 2**32), n=st.sampled_from([10, 20]), duty=st.floats(-0.12, 0.12))
def test_uneven_ring_is_a_ring(seed, n, duty):
    ring = uneven_ring(n, np.random.default_rng(seed), 0.03, duty)
    assert list(ring.edges) == sorted(ring.edges)
    assert ring.edges[0] == 0.0
    assert ring.edges[-1] < 1.0
    assert sum(ring.fractions) == pytest.approx(n)
    assert min(ring.fractions) > 0.5
    assert np.std(ring.fractions) > 0.0


def test_a_missing_tooth_is_one_long_interval():
    ring = uneven_ring(20, np.random.default_rng(0), 0.0, 0.0, missing=(3,))
    assert ring.n == 18
    assert max(ring.fractions) / min(ring.fractions) == pytest.approx(3.0)


@given(rates=st.lists(st.floats(-60.0, 60.0), min_size=1, max_size=20), seed=st.integers(0, 999))
@pytest.mark.slow
def test_count_is_the_number_of_marks_passed(rates, seed):
    """With any gear, every mark that passes the sensor is one edge."""
    ring = uneven_ring(20, np.random.default_rng(seed))
    encoder = MockEncoder(ring.edges)
    t, phase, expected = 0.0, 0.0, 0
    for rate in rates:
        encoder.set_rate(rate, t)
        later = phase + rate * 0.1
        low, high = sorted((phase, later))
        turns = range(int(np.floor(low)) - 1, int(np.floor(high)) + 2)
        marks = (turn + e for turn in turns for e in ring.edges)
        expected += sum(low < m <= high if rate > 0 else low <= m < high for m in marks)
        t, phase = t + 0.1, later
        encoder.run(t, ticks, 0)
    assert encoder.count == pytest.approx(expected, abs=len(rates))
    steady = MockEncoder(ring.edges)
    steady.set_rate(10.0, 0.0)
    steady.run(100.0 + 1e-6, ticks, 0)
    assert steady.count == 20_000


def test_slices_of_time_change_nothing():
    one, many = MockEncoder(even_ring(20).edges), MockEncoder(even_ring(20).edges)
    one.set_rate(33.3, 0.0)
    many.set_rate(33.3, 0.0)
    one.run(1.0, ticks, 0)
    for k in range(1, 10_001):
        many.run(k * 1e-4, ticks, 0)
    assert list(one.recent) == list(many.recent)
    assert one.count == many.count


def test_stamps_are_those_of_the_marks():
    encoder = MockEncoder(even_ring(20).edges)
    encoder.set_rate(5.0, 0.0)
    encoder.run(0.0501, ticks, 0)
    assert [ck for _, ck, _ in encoder.recent] == pytest.approx(
        [20_000, 40_000, 60_000, 80_000, 100_000], abs=1)
    assert [i for _, _, i in encoder.recent] == pytest.approx([0, 20_000, 20_000, 20_000, 20_000],
                                                              abs=1)


def test_glitch_rule_counts_rejects():
    encoder = MockEncoder(even_ring(20).edges)
    encoder.set_rate(1.0 / (20 * 70e-6), 0.0)  # one each 70 us: every second one is too early
    encoder.run(0.14, ticks, 200)
    assert encoder.rejected == pytest.approx(1000, abs=2)
    assert encoder.count == pytest.approx(1000, abs=2)


def test_long_interval_saturates():
    encoder = MockEncoder(even_ring(20).edges)
    encoder.set_rate(1.0, 0.0)                 # 50 ms per edge
    encoder.run(0.2, ticks, 200)
    assert encoder.interval_ck == 65535


def test_rocking_on_a_mark_counts_each_passage():
    encoder = MockEncoder(even_ring(20).edges)
    encoder.set_rate(1.0, 0.0)
    encoder.run(0.03, ticks, 0)
    before = encoder.count
    for k in range(10):                        # between 0.03 and 0.07 of a turn: over 0.05
        encoder.set_rate(1.0 if k % 2 == 0 else -1.0, 0.03 + k * 0.04)
        encoder.run(0.07 + k * 0.04, ticks, 0)
    assert encoder.count == before + 10


@pytest.mark.parametrize("phase", [0.0, 0.3, -0.4])
@pytest.mark.parametrize(("missing", "uneven"), [(0.1, 0.0), (0.25, 0.2), (-0.1, 0.0), (0.0, 0.5)])
def test_a_worn_ring_has_the_density_of_the_effect(missing, uneven, phase):
    """Marks passed from the start, against the integral that the effect's signal uses."""
    worn = wear_ring(even_ring(1000), missing, uneven, phase)

    def passed(turn):
        u = turn + phase
        rest, whole = u - math.floor(u), math.floor(u)
        gap = whole * missing + (min(rest, missing) if missing >= 0 else -min(rest, -missing))
        return u + uneven * math.sin(2 * math.pi * u) / (2 * math.pi) - gap

    assert list(worn.edges) == sorted(worn.edges)
    for turn in (0.05, 0.1, 0.37, 0.5, 0.77, 0.99):
        counted = sum(e < turn for e in worn.edges)
        # a gap in the density begins where uneven marks of the count end
        slack = 1000 * abs(missing * uneven) + 2
        assert counted == pytest.approx(1000 * (passed(turn) - passed(0.0)), abs=slack)


def test_two_turns_as_one_have_the_same_edges():
    ring = wear_ring(even_ring(20), 0.05, 0.1, 0.2)
    assert ring.n == 19
    double = double_ring(ring)
    turns = [2.0 * e for e in double.edges]
    assert turns == pytest.approx([*ring.edges, *(e + 1.0 for e in ring.edges)])
