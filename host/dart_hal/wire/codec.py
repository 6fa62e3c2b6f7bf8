"""Encode values as the bytes of a frame."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.wire import cobs
from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import LOG_TEXT_MIN, MESSAGES, Message

# Messages that a host receives.
UP = tuple(m for m in MESSAGES if m.dir == "up")

# Messages that a Nano receives.
DOWN = tuple(m for m in MESSAGES if m.dir == "down")

Values = Mapping[str, Any] | Sequence[Any]


def pack(message: Message, values: Values) -> bytes:
    """Encode the payload of a message.

    values: raw integers by field name (arrays as sequences; all fields are required), or in wire
    order with flat arrays, as from ``Frame.values()``. LOG: ``level`` and ``text`` (str or bytes);
    a text below 4 characters is padded with spaces. Raises UsageError.
    """
    flat = _flatten(message, values) if isinstance(values, Mapping) else tuple(values)
    if message.variable:
        return _pack_log(message, flat)
    try:
        return message.struct.pack(*flat)
    except struct.error as error:
        kinds = (f"{f.name} {f.type}" + f" x {f.count}" * (f.count > 1) for f in message.fields)
        raise UsageError(f"{message.name}: {error}", found=repr(values),
                         expected=", ".join(kinds)) from None


def wrap(message: Message, seq: int, payload: bytes) -> bytes:
    """Encode the frame of a payload: header, CRC, COBS and the final 0x00."""
    raw = bytes((message.id, seq & 0xFF)) + payload
    return cobs.encode(raw + crc16(raw, message.seed).to_bytes(2, "little")) + b"\0"


def encode(message: Message, seq: int, values: Values) -> bytes:
    """Encode the frame of a message; ``seq`` is taken modulo 256.

    ``values`` as in ``pack``. Raises UsageError.
    """
    return wrap(message, seq, pack(message, values))


def _flatten(message: Message, values: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the values in wire order with flat arrays. Raises UsageError."""
    names = [f.name for f in message.fields]
    if set(names) != set(values):
        wrong = sorted(set(names) ^ set(values))
        raise UsageError(f"{message.name}: missing or unknown: {', '.join(wrong)}",
                         expected=", ".join(names))
    flat: list[Any] = []
    for f in message.fields:
        value = values[f.name]
        if f.count == 1 or f.type == "text":
            flat.append(value)
        elif len(value) == f.count:
            flat += value
        else:
            raise UsageError(f"{message.name}.{f.name} has {f.count} elements",
                             found=repr(value))
    return tuple(flat)


def _pack_log(message: Message, flat: tuple[Any, ...]) -> bytes:
    limit = message.size - 1
    if len(flat) != 2 or flat[0] not in range(256):
        raise UsageError(f"{message.name} takes a level 0..255 and a text", found=repr(flat))
    text = flat[1]
    data = text.encode("ascii", "replace") if isinstance(text, str) else bytes(text)
    if len(data) > limit:
        raise UsageError(f"{message.name}: {len(data)} characters, at most {limit}")
    return bytes((flat[0],)) + data.ljust(LOG_TEXT_MIN)
