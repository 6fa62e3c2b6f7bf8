"""RC receiver and battery in the core: which pulses are a command, and the order of conversions."""

from __future__ import annotations

import ctypes as c

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire import messages
from dart_lab.sim.mock_inputs import GOOD_RUN, MockReceiver

U32 = 1 << 32
MS_TICKS = 2000
"""Ticks of a millisecond."""
FRAME_TICKS = 20 * MS_TICKS


class CoreReceiver:
    """The firmware's receiver with the methods of MockReceiver."""

    def __init__(self, core: c.CDLL, now: int = 0, levels: int = 0) -> None:
        self._core = core
        core.rc_new(c.c_uint32(now), levels)

    def edge(self, stamp: int, levels: int) -> None:
        self._core.rc_edge(c.c_uint32(stamp), levels)

    def gap(self, now: int, levels: int) -> None:
        self._core.rc_gap(c.c_uint32(now), levels)

    def frame(self, now: int) -> tuple[int, ...]:
        out = (c.c_uint8 * messages.RC.size)()
        self._core.rc_frame(c.c_uint32(now), out)
        return tuple(messages.RC.struct.unpack(bytes(out)))


def send_pulses(receiver: CoreReceiver, widths: list[int], start: int = 0,
                period: int = FRAME_TICKS) -> int:
    """Send pulses [ticks] on channel 0; return the time of the last fall."""
    t = start
    for k, width in enumerate(widths):
        t = start + k * period
        receiver.edge(t % U32, 1)
        t += width
        receiver.edge(t % U32, 0)
    return t


@pytest.mark.parametrize("start", [0, U32 - 3 * FRAME_TICKS])
@pytest.mark.parametrize("width", [1600, 3000, 4400])
def test_five_good_pulses_are_a_signal(core: c.CDLL, width: int, start: int) -> None:
    receiver = CoreReceiver(core, (start - FRAME_TICKS) % U32)
    end = send_pulses(receiver, [width] * (GOOD_RUN - 1), start)
    assert receiver.frame(end % U32)[1:] == (0, 0, 0, 255, 255, 255, 0)
    end = send_pulses(receiver, [width], start + (GOOD_RUN - 1) * FRAME_TICKS)
    assert receiver.frame((end + 7 * MS_TICKS) % U32)[1:] == (width, 0, 0, 7, 255, 255, 0)


@pytest.mark.parametrize("width", [1599, 4401, 10 * MS_TICKS])
def test_pulses_of_another_length_are_refused(core: c.CDLL, width: int) -> None:
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)
    end = send_pulses(receiver, [width] * 9)
    assert receiver.frame(end)[1:] == (0, 0, 0, 255, 255, 255, 9)


def test_a_bad_pulse_begins_the_count_again_but_ends_no_signal(core: c.CDLL) -> None:
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)
    end = send_pulses(receiver, [3000] * (GOOD_RUN - 1) + [1000] + [3000])
    assert receiver.frame(end)[1] == 0
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)
    end = send_pulses(receiver, [3000] * GOOD_RUN + [1000])
    pulse, age, refused = (receiver.frame(end)[i] for i in (1, 4, 7))
    assert (pulse, age, refused) == (3000, 19, 1), "the age is that of the good pulse"


def test_pulses_that_follow_too_soon_are_refused(core: c.CDLL) -> None:
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)
    end = send_pulses(receiver, [3000] * 20, period=8 * MS_TICKS - 1)
    assert receiver.frame(end)[1] == 0
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)
    end = send_pulses(receiver, [3000] * 20, period=8 * MS_TICKS)
    assert receiver.frame(end)[1] == 3000


def test_a_silence_ends_the_signal_however_long_it_is(core: c.CDLL) -> None:
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)
    end = send_pulses(receiver, [3000] * GOOD_RUN)
    assert receiver.frame(end + 100 * MS_TICKS)[1] == 3000
    assert receiver.frame(end + 101 * MS_TICKS)[1] == 0
    for later in range(500 * MS_TICKS, U32 + 1000 * MS_TICKS, 500_000 * MS_TICKS):  # a wrap
        assert receiver.frame((end + later) % U32)[1] == 0
    end = send_pulses(receiver, [3000], end + U32 + 1000 * MS_TICKS)
    assert receiver.frame(end % U32)[1] == 0, "it needs five again"


def test_a_pulse_across_a_gap_is_not_measured(core: c.CDLL) -> None:
    """Its fall comes by the interrupt after the masked time, with a length that looks good."""
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)
    end = send_pulses(receiver, [3000] * GOOD_RUN) + FRAME_TICKS
    receiver.gap(end, 1)
    receiver.edge(end + 2000, 0)
    assert receiver.frame(end + 2000)[1] == 3000
    receiver = CoreReceiver(core, -FRAME_TICKS % U32)     # control: the same edges without a gap
    end = send_pulses(receiver, [3000] * GOOD_RUN) + FRAME_TICKS
    receiver.edge(end, 1)
    receiver.edge(end + 2000, 0)
    assert receiver.frame(end + 2000)[1] == 2000


EVENTS = st.lists(st.tuples(st.sampled_from(("edge", "edge", "edge", "gap", "frame")),
                            st.one_of(st.integers(1, 300_000), st.sampled_from((3000, 37_000))),
                            st.integers(0, 7)), max_size=120)


@given(EVENTS, st.integers(0, U32 - 1))
def test_the_mock_decides_as_the_core(core: c.CDLL, events: list[tuple[str, int, int]],
                                      start: int) -> None:
    real = CoreReceiver(core, start)
    mock = MockReceiver(start)
    t = start
    for kind, step, levels in events:
        t = (t + step) % U32
        if kind == "frame":
            assert real.frame(t) == mock.frame(t)
        else:
            getattr(real, kind)(t, levels)
            getattr(mock, kind)(t, levels)
    assert real.frame(t) == mock.frame(t)


@pytest.mark.slow_except("50")
@pytest.mark.parametrize("rate", [50, 120, 400, 2000])
def test_noise_is_no_signal(core: c.CDLL, rate: int) -> None:
    """A minute of random edges on one pin. Control: the rates of a receiver above."""
    import numpy as np

    rng = np.random.default_rng(rate)
    receiver = CoreReceiver(core)
    gaps = rng.exponential(1000 * MS_TICKS / rate, 60 * rate).astype(int) + 1
    for k, t in enumerate(np.cumsum(gaps)):
        receiver.edge(int(t) % U32, k % 2)
        if k % 8 == 0:
            assert receiver.frame(int(t) % U32)[1] == 0


@given(st.lists(st.booleans(), max_size=200), st.integers(0, 255))
def test_the_ring_of_stamps_keeps_the_order_and_refuses_when_full(
        core: c.CDLL, puts: list[bool], start: int) -> None:
    core.stamps_new(start)
    waiting: list[tuple[int, int]] = []
    for n, put in enumerate(puts):
        if put:
            accepted = core.stamps_put((40_000 + n) & 0xFFFF, n & 7)
            assert accepted == (len(waiting) < 16)
            if accepted:
                waiting.append(((40_000 + n) & 0xFFFF, n & 7))
        else:
            found = core.stamps_take()
            assert found == (-1 if not waiting else waiting[0][0] << 8 | waiting[0][1])
            del waiting[:1]


def test_the_first_conversion_of_each_input_does_not_count(core: c.CDLL) -> None:
    """Order and sums of three rounds of conversions that are numbered."""
    core.meter_new()
    out = (c.c_uint8 * messages.BATTERY.size)()
    # 0 band gap, 1 A0 with pull-up, 2 A0: what the next conversion measures.
    order = [0, 0, 0, 0, 1, 1, 2, 2, 2, 2, 2, 0]
    for turn in range(3):
        counts = [100 * turn + k for k in range(12)]
        for k, count in enumerate(counts):
            assert not core.meter_take(out)
            assert core.meter_next(1000 * turn + k, count) == order[k]
        assert core.meter_take(out)
        assert messages.BATTERY.struct.unpack(bytes(out)) == (
            1000 * turn + 11, sum(counts[8:]), sum(counts[1:5]), counts[6])
