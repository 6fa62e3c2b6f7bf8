"""Frames: the same bytes from C++ and Python, and a parser that nothing upsets."""

from __future__ import annotations

import ctypes as c
import json
from pathlib import Path

import pytest
from firmware_rig import crc16
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire import codec, messages
from dart_hal.wire.decoder import FrameDecoder

FRAME_VECTORS = json.loads((Path(__file__).parents[1] / "wire/vectors.json").read_text())
FIXED = [m for m in messages.MESSAGES if not m.variable]
DOWN = [m for m in messages.MESSAGES if m.dir == "down"]


def frame(core: c.CDLL, id: int, seq: int, payload: bytes) -> bytes:
    out = (c.c_uint8 * 80)()
    n = core.core_frame(id, seq, payload, len(payload), out)
    return bytes(out[:n])


def parse(core: c.CDLL, data: bytes, chunk: int = 4096) -> tuple[list[tuple[int, int, bytes]],
                                                                 tuple[int, ...]]:
    core.parser_new()
    room = (c.c_uint8 * 65536)()
    counts = (c.c_uint16 * 4)()
    found = []
    for at in range(0, max(len(data), 1), chunk):
        part = data[at:at + chunk]
        n = core.parser_feed(part, len(part), room, len(room), counts)
        assert n >= 0
        raw = bytes(room[:n])
        i = 0
        while i < n:
            size = raw[i + 2]
            found.append((raw[i], raw[i + 1], raw[i + 3:i + 3 + size]))
            i += 3 + size
    return found, tuple(counts)


@pytest.mark.parametrize("vector", FRAME_VECTORS["crc"], ids=lambda v: v["data"][:8] or "empty")
def test_crc_of_the_golden_vectors(core: c.CDLL, vector: dict[str, object]) -> None:
    data = bytes.fromhex(str(vector["data"]))
    assert core.core_crc16(vector["seed"], data, len(data)) == vector["crc"]


@given(st.binary(max_size=60), st.integers(0, 0xFFFF))
def test_crc_is_the_polynomial(core: c.CDLL, data: bytes, seed: int) -> None:
    assert core.core_crc16(seed, data, len(data)) == crc16(data, seed)


def test_frames_of_the_golden_vectors(core: c.CDLL) -> None:
    for vector in FRAME_VECTORS["frames"]:
        message = messages.BY_NAME[vector["message"]]
        built = frame(core, message.id, vector["seq"], bytes.fromhex(vector["payload"]))
        assert built.hex() == vector["wire"], vector["message"]


@given(st.sampled_from(FIXED), st.integers(0, 255), st.data())
def test_every_message_gives_the_same_bytes(core: c.CDLL, message: messages.Message, seq: int,
                                            data: st.DataObject) -> None:
    payload = data.draw(st.one_of(
        st.binary(min_size=message.size, max_size=message.size),
        st.lists(st.sampled_from([0, 1, 0xFF]), min_size=message.size,
                 max_size=message.size).map(bytes)))
    assert frame(core, message.id, seq, payload) == \
        codec.encode(message, seq, codec_values(message, payload))


def codec_values(message: messages.Message, payload: bytes) -> dict[str, object]:
    flat = list(message.struct.unpack(payload))
    values = {}
    for f in message.fields:
        part = [flat.pop(0) for _ in range(f.count)]
        values[f.name] = part[0] if f.count == 1 else tuple(part)
    return values


@given(st.lists(st.tuples(st.sampled_from(DOWN), st.integers(0, 255)), min_size=1, max_size=8),
       st.data())
def test_the_parser_returns_what_was_sent(core: c.CDLL, sent: list[tuple[messages.Message, int]],
                                          data: st.DataObject) -> None:
    payloads = [data.draw(st.binary(min_size=m.size, max_size=m.size)) for m, _ in sent]
    stream = b"".join(codec.encode(m, seq, codec_values(m, p))
                      for (m, seq), p in zip(sent, payloads, strict=True))
    found, counts = parse(core, stream, data.draw(st.integers(1, 40)))
    assert found == [(m.id, seq, p) for (m, seq), p in zip(sent, payloads, strict=True)]
    assert counts[:3] == (len(sent), 0, 0)


@given(st.lists(st.sampled_from(DOWN), min_size=2, max_size=6), st.data())
def test_mutated_streams_cost_only_what_was_hit(core: c.CDLL, sent: list[messages.Message],
                                                data: st.DataObject) -> None:
    frames = [codec.encode(m, i, codec_values(m, bytes(m.size))) for i, m in enumerate(sent)]
    stream = bytearray(b"".join(frames))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(stream) - 1))
        kind = data.draw(st.sampled_from(["flip", "drop", "twice"]))
        if kind == "flip":
            stream[at] ^= 1 << data.draw(st.integers(0, 7))
        elif kind == "drop" and len(stream) > 1:
            del stream[at]
        else:
            stream.insert(at, stream[at])
    # Python's decoder repairs delimiters, the Nano's does not: never more than it.
    python = FrameDecoder().feed(bytes(stream) + b"\0")
    found, _ = parse(core, bytes(stream) + b"\0")
    accepted = [(f.message.id, f.seq, f.payload) for f in python]
    assert all(f in accepted for f in found)


@given(st.binary(max_size=200))
def test_a_good_frame_follows_any_noise(core: c.CDLL, noise: bytes) -> None:
    good = codec.encode(messages.HELLO_REQ, 7, {"proto": 1, "schema": 5, "flags": 0})
    found, _ = parse(core, noise + b"\0" + good)
    assert found[-1][:2] == (messages.HELLO_REQ.id, 7)


def test_errors_are_distinguished(core: c.CDLL) -> None:
    good = codec.encode(messages.PARAM_GET, 0, {"id": 3})
    bad_crc = bytes([*good[:3], good[3] ^ 0x40, *good[4:]])
    up = codec.encode(messages.PARAM_VALUE, 1, {"id": 1, "status": 0, "req_seq": 0, "value": 0})
    assert parse(core, bad_crc)[1] == (0, 1, 0, 0)
    assert parse(core, b"\x09abc\0")[1] == (0, 1, 0, 0)
    assert parse(core, up)[1] == (0, 0, 1, 0)  # not for the Nano
    assert parse(core, b"\x01" * 60 + b"\0")[1] == (0, 0, 1, 0)  # too long
    assert parse(core, b"\0\0\0" + good)[1] == (1, 0, 0, 0)  # empty blocks are nothing


def test_lost_frames_are_counted_and_a_new_host_starts_afresh(core: c.CDLL) -> None:
    get = [codec.encode(messages.PARAM_GET, seq, {"id": 1}) for seq in range(256)]
    hello = codec.encode(messages.HELLO_REQ, 40, {"proto": 1, "schema": 0, "flags": 0})
    assert parse(core, get[254] + get[255] + get[0] + get[3])[1] == (4, 0, 0, 2)
    assert parse(core, get[9] + hello + get[41])[1] == (3, 0, 0, 0)
