"""The contract of the stream decoder."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire import blocks, cobs
from dart_hal.wire.codec import DOWN, UP, encode
from dart_hal.wire.crc import crc16
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import BY_NAME, MAX_BLOCK, MESSAGES, STATE
from tests.wire import wire_samples as samples

ranges = {"u8": (0, 0xFF), "u16": (0, 0xFFFF), "u32": (0, 0xFFFF_FFFF), "i16": (-32768, 32767)}


ZEROS = STATE.struct.unpack(bytes(38))
PATTERN = STATE.struct.unpack(b"\x11" * 38)


def values_of(message):
    if message.variable:
        return st.tuples(st.integers(0, 255), st.binary(min_size=4, max_size=49))
    return st.tuples(*(st.integers(*ranges[f.type]) for f in message.fields
                       for _ in range(f.count)))


any_message = st.sampled_from(MESSAGES).flatmap(lambda m: st.tuples(st.just(m), values_of(m)))


@st.composite
def damaged_streams(draw):
    """A mixed stream with bytes changed, dropped, doubled and noise put in."""
    frames = samples.mix_frames(draw(st.integers(0, 12)), draw(st.integers(0, 2**32)))
    rng = Random(draw(st.integers(0, 2**32)))
    stream = b"".join(frames)
    for name in draw(st.lists(st.sampled_from([*samples.SMALL_FAULTS, "noise"]), max_size=6)):
        if name == "noise" or not stream:
            at = rng.randrange(len(stream) + 1)
            stream = stream[:at] + rng.randbytes(rng.randrange(600)) + stream[at:]
        else:
            stream = samples.SMALL_FAULTS[name](stream, rng)
    return stream


def whole(stream):
    decoder = FrameDecoder()
    return decoder.feed(stream), decoder.counters


@given(any_message, st.integers(0, 255))
def test_every_message_comes_back(message_values, seq):
    message, values = message_values
    wire = encode(message, seq, values)
    ((decoded, number, payload, end),) = whole(wire)[0]
    frame = whole(wire)[0][0]
    assert (decoded, number, end) == (message, seq, len(wire))
    assert frame.values() == values
    assert encode(message, seq, frame.as_dict()) == wire
    assert wire.count(0) == 1
    assert len(wire) == len(payload) + 6


@given(damaged_streams(), st.lists(st.integers(1, 90), min_size=1, max_size=30))
def test_cutting_the_stream_changes_nothing(stream, cuts):
    frames, counters = whole(stream)
    decoder = FrameDecoder()
    got = []
    at = 0
    i = 0
    while at < len(stream):
        got += decoder.feed(stream[at:at + cuts[i % len(cuts)]])
        at += cuts[i % len(cuts)]
        i += 1
    assert got == frames
    assert decoder.counters == counters


@given(damaged_streams())
def test_a_frame_comes_with_its_delimiter_and_not_before(stream):
    decoder = FrameDecoder()
    for at in range(len(stream)):
        for frame in decoder.feed(stream[at:at + 1]):
            if frame.end != at + 1:
                # The first of two frames whose delimiter was damaged is found
                # with the second.
                assert decoder.counters.repaired
            assert stream[at] == 0


@given(st.binary(max_size=2000))
def test_noise_never_raises(noise):
    decoder = FrameDecoder()
    decoder.feed(noise)
    decoder.feed(noise.replace(b"\0", b"\x10"))
    frame = encode(STATE, 3, ZEROS)
    assert [f.seq for f in decoder.feed(b"\0" + frame)] == [3]


@given(st.integers(0, 255), st.integers(0, 300), st.data())
def test_every_block_is_counted_once(kind, length, data):
    block = bytes([2, kind or 1]) + bytes(data.draw(st.lists(st.integers(1, 255), min_size=length,
                                                            max_size=length)))
    frames, counters = whole(block + b"\0")
    assert len(frames) + counters.damaged == 1 + counters.repaired // 2


def test_memory_is_bounded_and_a_flood_is_one_block():
    decoder = FrameDecoder()
    for _ in range(1000):
        decoder.feed(b"\x55" * 997)
        assert len(decoder._tail) <= MAX_BLOCK + 1
    frame = encode(STATE, 0, ZEROS)
    (got,) = decoder.feed(b"\0" + frame)
    assert decoder.counters.oversize == 1
    assert got.end == 997_000 + 1 + len(frame)


def test_empty_blocks_mean_nothing():
    frames, counters = whole(b"\0\0\0" + encode(STATE, 0, ZEROS) + b"\0\0")
    assert len(frames) == 1
    assert counters.damaged == 0


def test_kinds_of_damage_have_their_counter():
    good = encode(STATE, 0, PATTERN)
    assert whole(good[:-3] + good[-2:])[1].length == 1
    assert whole(bytes([2, 0x3E]) + good[2:])[1].unknown == 1
    assert whole(bytes([200]) + good[1:])[1].cobs == 1
    assert whole(good[:5] + bytes([good[5] ^ 1]) + good[6:])[1].crc == 1
    assert whole(b"\x01\0")[1].length == 1


def test_only_one_direction_is_accepted():
    up = encode(STATE, 0, ZEROS)
    down = encode(BY_NAME["HEARTBEAT"], 0, [0] * 6)
    assert [f.message.name for f in FrameDecoder(UP).feed(up + down)] == ["STATE"]
    assert [f.message.name for f in FrameDecoder(DOWN).feed(up + down)] == ["HEARTBEAT"]


@pytest.mark.parametrize("message", [m for m in MESSAGES if m.seed != 0xFFFF],
                         ids=lambda m: m.name)
def test_another_definition_cannot_be_read(message):
    """The same bytes under a seed that differs are refused for every value."""
    values = samples.random_values(message, Random(message.id))
    wire = encode(message, 0, values)

    class OtherSchema:
        id = message.id
        size = message.size
        variable = message.variable
        struct = message.struct
        seed = message.seed ^ 1

    assert FrameDecoder([OtherSchema()]).feed(wire) == []
    assert len(FrameDecoder([message]).feed(wire)) == 1


def test_changed_delimiter_is_repaired_for_every_pair():
    """For all ordered pairs of messages, LOG only behind."""
    rng = Random(5)
    for first in MESSAGES:
        for second in MESSAGES:
            a = encode(first, 1, samples.random_values(first, rng))
            b = encode(second, 2, samples.random_values(second, rng))
            frames, counters = whole(a[:-1] + bytes([rng.randrange(1, 256)]) + b)
            if first.variable:
                assert (counters.ok, counters.damaged) == (0, 1)
                continue
            assert [(f.message, f.seq, f.end) for f in frames] == [
                (first, 1, len(a)), (second, 2, len(a) + len(b))]
            assert (counters.repaired, counters.damaged) == (2, 0)


def test_repair_takes_both_checks():
    a = encode(STATE, 1, PATTERN)
    b = encode(STATE, 2, PATTERN)
    for joined in (a[:-1] + b"\x07" + b[:20] + bytes([b[20] ^ 0x40]) + b[21:],
                   a[:20] + bytes([a[20] ^ 0x40]) + a[21:-1] + b"\x07" + b):
        frames, counters = whole(joined)
        assert frames == []
        assert (counters.repaired, counters.length, counters.damaged) == (0, 1, 1)


def test_a_type_of_zero_is_no_frame():
    """Its second code byte can look like a type; even a right CRC does not help."""
    raw = bytes(1) + b"\x11" * 15 + bytes(1) + b"\x11" * 23
    block = cobs.encode(raw + crc16(raw, STATE.seed).to_bytes(2, "little"))
    assert (block[1], len(block)) == (STATE.id, STATE.wire_size - 1)
    counters = whole(block + b"\0")[1]
    assert (counters.ok, counters.cobs) == (0, 1)


@pytest.mark.parametrize(("length", "counter"), [
    (1, "length"), (5, "length"), (6, "unknown"), (256, "unknown"), (257, "oversize")])
def test_limits_of_an_unknown_block(length, counter):
    counters = whole(b"\x3e" * length + b"\0")[1]
    assert (getattr(counters, counter), counters.damaged) == (1, 1)


def test_reads_of_any_kind_of_buffer():
    frame = encode(STATE, 0, ZEROS)
    for data in (frame, bytearray(frame), memoryview(frame)):
        assert len(FrameDecoder().feed(data)) == 1


def test_sizes_of_blocks_follow_the_definitions():
    assert list(blocks.block_sizes(STATE)) == [43]
    assert list(blocks.block_sizes(BY_NAME["LOG"])) == list(range(10, 56))
