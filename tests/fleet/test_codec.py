"""Frames between cars: what is sent arrives, and all else is counted, never raised."""

from __future__ import annotations

from zlib import crc32

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import UsageError
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Decoder, encode
from tests.fleet.rooms import pose_frame


def numbers(f):
    if f.type == "u8":
        return st.integers(0, int(min(f.high, 255)))
    if f.type == "u32":
        return st.integers(int(max(f.low, 0)), 2**32 - 1)
    low = max(f.low, -1e6)
    high = min(f.high, 1e6)
    return st.floats(low, high, width=32 if f.type in ("f32", "rows") else 64)


def values(f):
    if f.type == "text":
        return st.text(st.characters(codec="ascii", min_codepoint=32, max_codepoint=126),
                       min_size=1, max_size=f.count)
    if f.type == "bytes":
        return st.binary(max_size=f.count)
    if f.type == "pairs":
        return st.lists(st.tuples(*[st.integers(0, 2**32 - 1)] * f.count),
                        max_size=m.MAX_ROWS).map(tuple)
    row = st.tuples(*[numbers(m.Field(f.name, f.type, "", 1, f.low, f.high))] * f.count)
    if f.type == "rows":
        return st.lists(row, max_size=m.MAX_ROWS).map(tuple)
    return row if f.count > 1 else numbers(f)


frames = st.sampled_from(m.KINDS).flatmap(lambda kind: st.tuples(
    st.just(kind), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1),
    st.integers(0, 10**12).map(lambda us: us * 1e-6), st.tuples(*map(values, kind.fields))))


@given(frames)
def test_what_is_sent_arrives(frame):
    kind, boot, seq, sent, value = frame
    data = encode(kind, boot, seq, sent, value)
    assert len(data) <= m.MAX_FRAME_BYTES
    heard = Decoder().decode(data)
    assert (heard.kind, heard.boot, heard.seq, heard.values) == (kind, boot, seq, value)
    assert heard.sent == pytest.approx(sent, abs=1e-6)


def are_all_counted(decoder, tries):
    c = decoder.counters
    return c.ok + c.refused == tries


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_junk_is_counted(junk):
    decoder = Decoder()
    assert [decoder.decode(data) for data in junk] == [None] * len(junk)
    assert are_all_counted(decoder, len(junk))
    assert decoder.counters.ok == 0


@given(frames, st.data())
def test_a_damaged_frame_is_refused(frame, data):
    good = encode(*frame)
    at = data.draw(st.integers(0, len(good) - 1))
    bit = data.draw(st.integers(0, 7))
    bad = bytearray(good)
    bad[at] ^= 1 << bit
    decoder = Decoder()
    assert decoder.decode(bytes(bad)) is None, "CRC-32 finds every single bit"
    assert decoder.decode(good[:data.draw(st.integers(0, len(good) - 1))]) is None
    assert decoder.decode(good + b"x") is None
    assert decoder.decode(good) is not None
    assert are_all_counted(decoder, 4)


@given(st.sampled_from(m.KINDS), st.binary(max_size=200))
def test_a_body_that_lies_under_a_good_checksum_is_refused_or_possible(kind, body):
    """Any sender can also compute the CRC: lengths and numbers are checked all the same."""
    head = m.HEAD.pack(m.MAGIC, m.VERSION, kind.id, 1, 2, 3) + body
    decoder = Decoder()
    heard = decoder.decode(head + crc32(head, kind.seed).to_bytes(4, "little"))
    assert are_all_counted(decoder, 1)
    if heard is not None:
        assert heard.name.isprintable()
        for f, v in zip(kind.fields, heard.values, strict=True):
            assert f.type != "bytes" or len(v) <= f.count
            if f.type in m.FORMATS:
                assert all(f.low <= x <= f.high for x in (v if f.count > 1 else (v,)))


def test_each_fault_has_its_counter():
    good = pose_frame(1)
    decoder = Decoder()
    for data in (good[:10], b"\0" * 5000, b"XX" + good[2:], good[:2] + b"\x09" + good[3:],
                 good[:3] + b"\xee" + good[4:], good[:-1] + bytes((good[-1] ^ 1,))):
        assert decoder.decode(data) is None
    c = decoder.counters
    assert (c.short, c.huge, c.foreign, c.version, c.unknown, c.crc) == (1,) * 6


def test_another_definition_of_a_message_is_refused():
    changed = m.Kind(m.STOP.name, m.STOP.id, "", (*m.STOP.fields, m.Field("x", "u8", "")))
    assert changed.seed != m.STOP.seed
    decoder = Decoder()
    assert decoder.decode(encode(changed, 1, 1, 0.0, ("red", 1, "why", 1))) is None
    assert decoder.counters.crc == 1


@pytest.mark.parametrize("value", [("red", 0, "why"), ("", 1, "why"), ("r" * 33, 1, ""),
                                   ("red\n", 1, ""), ("red", 1)])
def test_what_is_no_value_cannot_be_sent(value):
    with pytest.raises(UsageError, match="STOP"):
        encode(m.STOP, 1, 1, 0.0, value)


def test_seeds_and_ids_differ():
    assert len({k.seed for k in m.KINDS}) == len(m.BY_ID) == len(m.KINDS)
