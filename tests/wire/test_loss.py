"""sent = ok + lost, exactly."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire import ledger
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import STATE
from tests.wire import wire_samples as samples

DRIVE = samples.drive(40.0, seed=1)


def count_lost(frames):
    decoder = FrameDecoder(UP)
    decoder.feed(b"".join(frames))
    return decoder.counters.gaps


@given(st.sets(st.integers(1, 598)))
def test_any_frames_may_be_missing(missing):
    frames = [f for i, f in enumerate(DRIVE[:600]) if i not in missing]
    assert count_lost(frames) == len(missing)


@given(st.integers(0, 2**32), st.floats(0.0, 0.3))
def test_damage_counts_as_lost(seed, share):
    """Frames hurt on the line are lost just as those that never came."""
    rng = Random(seed)
    inner = [samples.change_byte(f[:-1], rng).replace(b"\0", b"\x01") + b"\0"
             if rng.random() < share else f for f in DRIVE[1:400]]
    decoder = FrameDecoder(UP)
    decoder.feed(b"".join([DRIVE[0], *inner, DRIVE[400]]))
    assert decoder.counters.ok + decoder.counters.gaps == 401


@pytest.mark.slow_except("51-*")
@pytest.mark.parametrize("length", [1, 100, 254, 255, 256, 257, 511, 512, 600, 1500, 3000])
@pytest.mark.parametrize("start", [50, 51, 57, 700])
def test_long_silence_is_counted_by_device_time(length, start):
    assert count_lost(DRIVE[:start] + DRIVE[start + length:]) == length


def test_the_sequence_number_alone_would_not_do(monkeypatch):
    """Negative control."""
    monkeypatch.setattr(ledger, "MAX_EXACT_SILENCE", ledger.MASK32)
    assert count_lost(DRIVE[:50] + DRIVE[650:]) == 600 % 256


def two_states(periods, step):
    """Counters after two STATE frames separated by so many periods and sequence numbers."""
    values = list(STATE.struct.unpack(bytes(38)))
    stream = encode(STATE, 9, values)
    values[0] = periods * ledger.STATE_PERIOD
    stream += encode(STATE, 9 + step, values)
    decoder = FrameDecoder(UP)
    decoder.feed(stream)
    return decoder.counters.gaps


def test_a_busy_nano_may_leave_out_some():
    """Slots it skipped have no number; a few of them do not pass for another round."""
    assert two_states(300, 295) == 294
    assert two_states(200, 200 - ledger.MAX_SKIPPED_STATES) == 199 - ledger.MAX_SKIPPED_STATES
    assert two_states(200, 199 - ledger.MAX_SKIPPED_STATES) == 198 - ledger.MAX_SKIPPED_STATES + 256


@pytest.mark.parametrize(("short", "added"), [(-300, 0), (0, 0), (1, 256), (256, 256), (257, 512)])
def test_rounds(short, added):
    elapsed = (short + ledger.MAX_SKIPPED_STATES + 400) * ledger.STATE_PERIOD
    assert ledger.count_wrapped(elapsed, 400) == added


def test_what_is_missing_at_the_ends_is_not_claimed():
    assert count_lost(DRIVE[5:100]) == 0


def test_another_boot_begins_a_new_account():
    decoder = FrameDecoder(UP)
    decoder.feed(b"".join(DRIVE[:100] + samples.drive(1.0, seed=2, boot=2)))
    assert (decoder.counters.gaps, decoder.counters.rebased) == (0, 1)


def test_a_second_hello_of_the_same_boot_does_not():
    hello = FrameDecoder(UP).feed(DRIVE[0])[0]
    frames = [*DRIVE[:10], encode(hello.message, 12, hello.values()), *DRIVE[13:20]]
    decoder = FrameDecoder(UP)
    decoder.feed(b"".join(frames))
    assert (decoder.counters.gaps, decoder.counters.rebased) == (2, 0)


def test_time_that_runs_backwards_begins_a_new_account():
    values = list(STATE.struct.unpack(bytes(38)))
    frames = []
    for seq, t in ((0, 5_000_000), (1, 5_020_000), (40, 60_000), (41, 80_000)):
        values[0] = t
        frames.append(encode(STATE, seq, values))
    decoder = FrameDecoder(UP)
    decoder.feed(b"".join(frames))
    assert (decoder.counters.gaps, decoder.counters.rebased) == (0, 1)


def test_the_wrap_of_device_time_is_no_event():
    values = list(STATE.struct.unpack(bytes(38)))
    frames = []
    for seq in range(8):
        values[0] = (2**32 - 60_000 + seq * ledger.STATE_PERIOD) % 2**32
        if seq != 4:
            frames.append(encode(STATE, seq, values))
    decoder = FrameDecoder(UP)
    decoder.feed(b"".join(frames))
    assert (decoder.counters.gaps, decoder.counters.rebased) == (1, 0)
