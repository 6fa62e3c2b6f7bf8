"""Golden vectors: frames that every implementation of the protocol must reproduce.

The Python codec, the native build of the firmware's core and the firmware in the emulator are
tested with the same JSON.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from dart_hal.wire import cobs
from dart_hal.wire.codec import encode, pack
from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import MESSAGES, PROTO, SCHEMA, TYPES, Message, MessageField

_RANGES = {"u8": (0, 0xFF), "u16": (0, 0xFFFF), "u32": (0, 0xFFFF_FFFF), "i16": (-32768, 32767)}
_TEXTS = ("boot", "i2c: no answer from 0x28", "x" * 49)


def render_vectors(messages: Sequence[Message] = MESSAGES) -> str:
    """Return the text of ``tests/wire/vectors.json``, one vector per line."""
    sections: dict[str, Any] = {
        "proto": PROTO,
        "schema": SCHEMA,
        "crc": _crc(),
        "cobs": _cobs(),
        "messages": [{"name": m.name, "id": m.id, "size": m.size, "seed": m.seed, "text": m.text}
                     for m in messages],
        "frames": [frame for m in messages for frame in _frames(m)],
    }
    lines = [f"{json.dumps(key)}: {_json(value)}" for key, value in sections.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _json(value: Any) -> str:
    if not isinstance(value, list):
        return json.dumps(value)
    return "[\n" + ",\n".join("  " + json.dumps(item) for item in value) + "\n]"


def _crc() -> list[dict[str, Any]]:
    cases = [(b"123456789", 0xFFFF), (bytes(range(40)), 0xFFFF), (b"", 0x1234), (b"\0", 0),
             (bytes(range(256)), 0xBEEF)]
    return [{"data": data.hex(), "seed": seed, "crc": crc16(data, seed)} for data, seed in cases]


def _cobs() -> list[dict[str, str]]:
    ones = b"\x01"
    cases = [b"", b"\0", b"\0\0", b"\x11", b"\x11\0", b"\0\x11", b"\x11\x22\0\x33",
             ones * 253, ones * 254, ones * 255, ones * 254 + b"\0", b"\0" + ones * 254]
    return [{"raw": raw.hex(), "block": cobs.encode(raw).hex()} for raw in cases]


def _frames(m: Message) -> list[dict[str, Any]]:
    """Return frames with zeros, both ends of every range, and a pattern of different bytes."""
    if m.variable:
        values = [{"level": i, "text": text} for i, text in enumerate(_TEXTS)]
    else:
        values = [_fill_fields(m, kind) for kind in ("zero", "low", "high", "pattern")]
    return [{"message": m.name, "seq": seq, "values": v, "payload": pack(m, v).hex(),
             "wire": encode(m, seq, v).hex()}
            for seq, v in zip((0, 1, 255, 0x5A), values, strict=False)]


def _fill_fields(m: Message, kind: str) -> dict[str, Any]:
    offset = 0
    values: dict[str, Any] = {}
    for f in m.fields:
        elements = []
        for _ in range(f.count):
            elements.append(_field_value(f, kind, offset))
            offset += len(_pattern_bytes(f, offset))
        values[f.name] = elements if f.count > 1 else elements[0]
    return values


def _field_value(f: MessageField, kind: str, offset: int) -> int:
    low, high = _RANGES[f.type]
    if kind == "pattern":
        return int.from_bytes(_pattern_bytes(f, offset), "little", signed=low < 0)
    return {"zero": 0, "low": low, "high": high}[kind]


def _pattern_bytes(f: MessageField, offset: int) -> bytes:
    """Return the bytes at ``offset`` of the pattern 0x81, 0x82, ..."""
    width = {"B": 1, "H": 2, "h": 2, "I": 4}[TYPES[f.type]]
    return bytes(0x81 + offset + i for i in range(width))
