"""A received frame, and the positions of the fields in its values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import make_dataclass
from functools import cache
from typing import Any, NamedTuple

from dart_hal.wire.messages import MESSAGES, Message, MessageField


class WireFrame(NamedTuple):
    """One accepted frame.

    seq: 0..255; payload: raw bytes; end: offset after the frame's delimiter, in bytes since the
    construction of the decoder.
    """

    message: Message
    seq: int
    payload: bytes
    end: int = 0

    def values(self) -> tuple[Any, ...]:
        """Return the raw integers in wire order, arrays flat; LOG: (level, text as bytes)."""
        if self.message.variable:
            return self.payload[0], self.payload[1:]
        return self.message.struct.unpack(self.payload)

    def as_dict(self) -> dict[str, Any]:
        """Return the raw values by name; arrays as tuples."""
        values = self.values()
        return {name: values[index] for name, index in layout(self.message.id).items()}

    def as_si(self) -> dict[str, Any]:
        """Return the values by name, multiplied by the scale of their field."""
        raw = self.as_dict()
        return {f.name: _to_si(f, raw[f.name]) for f in self.message.fields}

    def record(self) -> Any:
        """Return the raw values as a frozen dataclass with the name of the message."""
        return record_type(self.message.id)(**self.as_dict())


def _to_si(f: MessageField, raw: Any) -> Any:
    if f.type == "text" or f.scale == 1.0:
        return raw
    return raw * f.scale if f.count == 1 else tuple(v * f.scale for v in raw)


@cache
def layout(ident: int) -> Mapping[str, int | slice]:
    """Return the index (scalar) or slice (array) of each field in ``Frame.values()``."""
    places: dict[str, int | slice] = {}
    start = 0
    for f in _by_id(ident).fields:
        width = 1 if f.type == "text" else f.count
        places[f.name] = start if width == 1 else slice(start, start + width)
        start += width
    return places


@cache
def record_type(ident: int) -> type:
    """Return the frozen dataclass of a message: ``State``, ``HelloReq``..."""
    message = _by_id(ident)
    name = "".join(word.capitalize() for word in message.name.split("_"))
    return make_dataclass(name, [f.name for f in message.fields], frozen=True, slots=True)


def _by_id(ident: int) -> Message:
    return next(m for m in MESSAGES if m.id == ident)
