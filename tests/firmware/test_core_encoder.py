"""Encoder core: exact counts and times through the wraps of 16 and 32 bits."""

from __future__ import annotations

import ctypes as c

import pytest
from hypothesis import given
from hypothesis import strategies as st

U32 = 1 << 32


def run(core: c.CDLL, edges: list[int], updates: list[int], start: int) -> list[tuple[int, ...]]:
    """What the core reports at each update time; times are unwrapped ticks after start."""
    core.encoder_new(start % U32)
    out = (c.c_uint32 * 3)()
    results = []
    for now in updates:
        past = [e for e in edges if e <= now]
        last = past[-1] if past else 0
        first = past[-2] if len(past) > 1 else 0
        core.encoder_update((start + now) % U32, len(past) & 0xFFFF, (start + last) & 0xFFFF,
                            (start + first) & 0xFFFF, out)
        results.append(tuple(out))
    return results


@given(st.lists(st.integers(200, 200_000), max_size=60),
       st.integers(0, U32 - 1), st.integers(1000, 59_000))
def test_counts_times_and_intervals_are_exact(core: c.CDLL, gaps: list[int], start: int,
                                              step: int) -> None:
    edges = []
    t = 0
    for gap in gaps:
        t += gap
        edges.append(t)
    updates = list(range(step, t + 2 * step, step))
    for now, (count, last, interval) in zip(updates, run(core, edges, updates, start),
                                            strict=True):
        past = [e for e in edges if e <= now]
        assert count == len(past)
        if not past:
            assert (last, interval) == (0, 0)
            continue
        assert last == (start + past[-1]) % U32
        true = past[-1] - past[-2] if len(past) > 1 else 0
        assert interval == min(true, 65535)


def test_a_pause_of_a_whole_clock_wrap_is_a_long_interval(core: c.CDLL) -> None:
    edges = [1000, 1000 + U32 + 5000]
    updates = [2000, *range(20_000, U32 + 20_000, 20_000_000), U32 + 20_000]
    updates = sorted(set(updates))
    assert run(core, edges, updates, 0)[-1] == (2, (1000 + 5000), 65535)


def test_a_late_loop_never_invents_an_interval(core: c.CDLL) -> None:
    # 100 ms without an update: stamps have wrapped, the interval is unknown.
    assert run(core, [100, 150_000, 199_000], [1000, 200_000], 0)[-1][2] == 65535


@pytest.mark.parametrize("minimum", [1, 200, 10_000])
@given(gaps=st.lists(st.integers(1, 100_000), min_size=1, max_size=80),
       start=st.integers(0, 0xFFFF))
def test_the_glitch_rule_keeps_exactly_the_edges_far_from_the_last(
        core: c.CDLL, minimum: int, gaps: list[int], start: int) -> None:
    core.counter_new(0, minimum)
    out = (c.c_uint16 * 10)()
    t = 0
    refreshed = 0
    level = 0
    accepted = None
    kept = 0
    last_level = 0
    for gap in gaps:
        t += gap
        while refreshed + 7000 < t:  # the slot interrupt, each 3.5 ms
            refreshed += 7000
            core.counter_refresh((start + refreshed) & 0xFFFF)
        level ^= 1
        core.counter_edge((start + t) & 0xFFFF, level)
        far = accepted is None or t - accepted >= minimum  # 32-bit law
        if far and level != last_level:
            accepted = t
            last_level = level
            kept = kept + 1
    core.counter_get(out)
    assert (out[0], out[1]) == (kept, len(gaps) - kept)


def test_edges_separated_by_a_16_bit_wrap_are_not_glitches(core: c.CDLL) -> None:
    core.counter_new(0, 200)
    out = (c.c_uint16 * 10)()
    for n in range(50):
        core.counter_edge(1234 + n * 5 & 0xFFFF, (n + 1) & 1)  # separated by 32.77 ms and 2.5 us
        for phase in range(1, 9):
            core.counter_refresh(1234 + phase * 7000 & 0xFFFF)
    core.counter_get(out)
    assert (out[0], out[1]) == (50, 0)


def test_without_the_rule_every_edge_counts(core: c.CDLL) -> None:
    core.counter_new(0, 0)
    out = (c.c_uint16 * 10)()
    for t in range(20):
        core.counter_edge(t, 0)
    core.counter_get(out)
    assert (out[0], out[1]) == (20, 0)
    assert sorted(out[2:]) == list(range(12, 20))


def test_edges_frames_hold_eight_successive_intervals(core: c.CDLL) -> None:
    core.edge_log_new()
    core.edge_log_request(2)
    payload = (c.c_uint8 * 24)()
    frames = []
    t = 5000
    for count in range(1, 40):
        t += 1000 + count if count != 12 else 70_000
        if core.edge_log_add(count, t):
            core.edge_log_take(payload)
            raw = bytes(payload)
            words = [int.from_bytes(raw[i:i + 2], "little") for i in range(8, 24, 2)]
            frames.append((int.from_bytes(raw[:4], "little"), words))
    assert frames == [(2, [1000 + n for n in range(2, 10)]),
                      (10, [1010, 1011, 65535, *(1000 + n for n in range(13, 18))])]
    assert not core.edge_log_active()


def test_a_gap_starts_the_frame_again(core: c.CDLL) -> None:
    core.edge_log_new()
    core.edge_log_request(1)
    for count in range(1, 6):
        assert not core.edge_log_add(count, count * 1000)
    core.edge_log_gap()
    ready = [count for count in range(10, 30) if core.edge_log_add(count, count * 1000)]
    assert ready[0] == 18  # one edge to start from, then eight intervals


def test_direction_is_ambiguous_until_the_wheel_has_stopped(core: c.CDLL) -> None:
    core.direction_new()
    core.direction_command(1)
    assert [core.direction_update(n) & 1 for n in range(30)] == [0] * 30
    core.direction_command(2)
    assert all(core.direction_update(30 + n) & 1 for n in range(10))
    core.direction_command(1)  # the sign came back, but what happened between?
    assert core.direction_update(41) & 1
    stopped = [core.direction_update(41) for _ in range(20)]
    assert stopped[-2] & 1
    assert stopped[-1] == 2
    core.direction_command(2)
    assert not core.direction_update(41) & 1
    assert not core.direction_update(42) & 1  # moving off in reverse is clear


def test_an_unknown_direction_changes_nothing(core: c.CDLL) -> None:
    core.direction_new()
    core.direction_command(1)
    core.direction_update(1)
    core.direction_command(0)
    assert not core.direction_update(2) & 1


# --- budget and rule ----------------------------------------------------------

def read_counter(core: c.CDLL) -> tuple[int, int]:
    out = (c.c_uint16 * 10)()
    core.counter_get(out)
    return out[0], out[1]


@pytest.mark.parametrize(("min_ticks", "budget"), [(0, 255), (20, 255), (200, 77), (10_000, 64)])
def test_a_phase_takes_its_budget_of_edges(core: c.CDLL, min_ticks: int, budget: int) -> None:
    core.counter_new(0, min_ticks)
    for phase in range(3):
        served = [core.counter_edge(phase * 7000 + n & 0xFFFF, n + 1 & 1) for n in range(budget)]
        assert served == [1] * (budget - 1) + [0]
        core.counter_refresh((phase + 1) * 7000 & 0xFFFF)
    assert sum(read_counter(core)) == 3 * budget


@pytest.mark.parametrize("min_ticks", [0, 200])
def test_what_the_rule_accepts_never_uses_the_budget_up(core: c.CDLL, min_ticks: int) -> None:
    """Without the rule 40000 edges/s, with it the 10000 that it accepts; phase of 6.1 ms."""
    core.counter_new(0, min_ticks)
    step = min_ticks or 50
    for n in range(12_200 // step):
        assert core.counter_edge(n * step & 0xFFFF, n + 1 & 1)


@pytest.mark.parametrize("first", [0, 200, 300])
@pytest.mark.parametrize("second", [0, 200, 300])
def test_a_new_rule_does_not_swallow_an_edge_that_waits(core: c.CDLL, first: int,
                                                        second: int) -> None:
    core.counter_new(0, first)
    core.counter_edge(1000, 1)
    core.counter_rule(second)  # the pin is low again, its interrupt waits
    core.counter_edge(5000, 0)
    core.counter_edge(9000, 1)
    assert read_counter(core) == (3, 0)
