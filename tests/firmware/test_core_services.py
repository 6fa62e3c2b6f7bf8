"""Events, pulse capture, line rate: the small parts of the core."""

from __future__ import annotations

import ctypes as c

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire import messages


def take(core: c.CDLL) -> tuple[int, ...] | None:
    out = (c.c_uint8 * 10)()
    return messages.EVENT.struct.unpack(bytes(out)) if core.events_take(out) else None


def test_each_event_is_sent_three_times_in_order(core: c.CDLL) -> None:
    core.events_new()
    for n in range(3):
        core.events_push(n * 100, 2 + n, n)
    sent = [take(core) for _ in range(10)]
    assert sent == [(n * 100, 2 + n, n, n) for n in range(3) for _ in range(3)] + [None]


def test_a_lost_event_leaves_a_gap_in_the_count(core: c.CDLL) -> None:
    core.events_new()
    for n in range(6):
        core.events_push(n, 1, n)
    while (event := take(core)) is not None:
        last = event
    core.events_push(9, 1, 9)
    after = take(core)
    assert after is not None
    assert after[2] == 6
    assert last[2] < 5


@given(st.lists(st.integers(1600, 5000), min_size=1, max_size=30), st.integers(0, 2**32 - 1))
def test_capture_sums_what_it_saw(core: c.CDLL, highs: list[int], start: int) -> None:
    core.capture_begin(len(highs))
    out = (c.c_uint8 * 18)()
    running = 1
    t = start
    core.capture_edge(c.c_uint32(t - 500), 0, out)  # the end of a pulse that began before
    for high in highs:
        assert core.capture_edge(c.c_uint32(t), 1, out)
        running = core.capture_edge(c.c_uint32(t + high), 0, out)
        t += 40_000
    assert running
    assert not core.capture_edge(c.c_uint32(t), 1, out)
    assert messages.CAPTURE.struct.unpack(bytes(out)) == (
        start, t % 2**32, sum(highs), len(highs), min(highs), max(highs))


def window(core: c.CDLL, per_slot: int, valid: bool, framing: list[int]) -> bool:
    results = [core.baud_slot(per_slot, int(valid and i == 7), framing[i * len(framing) // 300])
               for i in range(300)]
    assert not any(results[:-1])
    return bool(results[-1])


def test_the_line_rate_is_wrong_only_with_errors_and_without_a_frame(core: c.CDLL) -> None:
    core.baud_new()
    assert not window(core, 0, False, [0])  # silence
    assert not window(core, 0, False, [20])  # a few errors
    assert window(core, 0, False, [41])  # 21 more
    assert not window(core, 0, True, [255])  # one frame outweighs all
    assert not window(core, 0, False, [3])  # the counter has wrapped: 4 more
    assert window(core, 1, False, [3])  # 300 bytes and none of them a frame


# --- what the slot interrupt and the watchdog ask -----------------------------

@pytest.mark.parametrize(("limit_ms", "slots"), [(50, 5), (105, 11), (110, 11), (1000, 100)])
def test_the_interrupts_own_limit_in_slots(core: c.CDLL, limit_ms: int, slots: int) -> None:
    core.beats_new()
    assert core.beats_slot()  # no bytes yet
    core.beats_beat(limit_ms)
    assert [core.beats_slot() for _ in range(slots + 2)] == [0] * slots + [1, 1]


def test_a_beat_that_comes_after_the_cut_reports_it(core: c.CDLL) -> None:
    core.beats_new()
    core.beats_beat(110)
    for cut in (False, True):
        for _ in range(11 + cut):
            core.beats_slot()
        assert bool(core.beats_beat(110)) is cut
    assert not core.beats_beat(110), "once"


def test_a_beat_winds_the_limit_up_again(core: c.CDLL) -> None:
    core.beats_new()
    for _ in range(30):
        core.beats_beat(110)
        assert not any(core.beats_slot() for _ in range(11))


@pytest.mark.parametrize(("slots", "sent", "made"), [
    (6, 9, True), (5, 9, False), (6, 8, False), (5, 8, False), (4, 7, True)])
def test_progress_is_that_both_counters_moved(core: c.CDLL, slots: int, sent: int,
                                              made: bool) -> None:
    core.progress_new(5, 8)
    assert bool(core.progress_made(slots, sent)) is made
    assert not core.progress_made(slots, sent)
