"""The line model: rates are kept, order is kept, a seed repeats itself."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import UsageError
from dart_lab.sim.faults import Latency, Line, LineFaults, latency_model


@given(data=st.lists(st.binary(max_size=60), max_size=20))
def test_a_perfect_line_changes_nothing(data):
    line = Line()
    for k, chunk in enumerate(data):
        assert line.carry(chunk, k * 0.01) == (chunk, k * 0.01)


@given(seed=st.integers(0, 1000))
def test_a_seed_repeats_itself(seed):
    faults, latency = LineFaults(1e-3, 0.01, 0.01, 0.001), latency_model("usb")
    lines = [Line(faults, latency, (seed,)) for _ in range(2)]
    results = [[line.carry(bytes(range(40)), k * 0.01) for k in range(30)] for line in lines]
    assert results[0] == results[1]


def test_bit_error_rate_is_kept():
    line = Line(LineFaults(bit_error=1e-3))
    sent = bytes(1000)
    flipped = sum(bin(b).count("1") for _ in range(100) for b in line.carry(sent, 0.0)[0])
    assert flipped == pytest.approx(800, rel=0.15)


def test_drop_and_duplicate():
    assert len(Line(LineFaults(drop=0.1)).carry(bytes(100_000), 0.0)[0]) == pytest.approx(
        90_000, rel=0.01)
    assert len(Line(LineFaults(duplicate=0.1)).carry(bytes(100_000), 0.0)[0]) == pytest.approx(
        110_000, rel=0.01)


def test_a_burst_runs_over_the_end_of_a_chunk():
    line = Line(LineFaults(burst=1.0, burst_length=8))
    line.carry(b"\xaa", 0.0)
    line.faults = LineFaults(drop=1e-12)
    damaged = line.carry(bytes(100), 0.0)[0]
    assert damaged[:7] != bytes(7)
    assert damaged[7:] == bytes(93)


def test_silence():
    line = Line(LineFaults(silence=[(1.0, 1.1)]))
    assert [line.carry(b"x", t)[0] for t in (0.99, 1.0, 1.09, 1.1)] == [b"x", b"", b"", b"x"]


def test_order_is_never_broken():
    line = Line(None, Latency(0.0, 0.2, (0.001, 0.04)))
    times = [line.carry(b"x", k * 1e-3)[1] for k in range(2000)]
    assert times == sorted(times)
    assert max(t - k * 1e-3 for k, t in enumerate(times)) > 0.03


def test_unknown_jitter_lists_the_known():
    with pytest.raises(UsageError) as caught:
        latency_model("bluetooth")
    assert "usb" in caught.value.expected
