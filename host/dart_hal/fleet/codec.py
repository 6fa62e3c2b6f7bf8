"""From values to frames and back, without I/O. ``Decoder`` never raises, whatever comes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from struct import Struct, error
from typing import Any, NamedTuple
from zlib import crc32

from dart_hal.errors import UsageError
from dart_hal.fleet.messages import (
    BY_ID,
    FORMATS,
    HEAD,
    LARGEST,
    MAGIC,
    POINTS,
    VERSION,
    Field,
    Kind,
)

_CRC = Struct("<I")
RECENT = 512
"""Frames whose values are kept: cars of one process then decode a frame once, not each for
itself."""


class Heard(NamedTuple):
    """One good frame. values: in the order of ``kind.fields``; a count > 1 and rows as tuples."""

    kind: Kind
    boot: int
    seq: int
    sent: float
    values: tuple[Any, ...]

    @property
    def name(self) -> str:
        """Who told it."""
        return str(self.values[0])


@dataclass
class Counters:
    """ok: frames returned. The others by what was found first: short, huge (beyond
    ``LARGEST``), foreign (no frame of ours), version, unknown (kind), crc, body (fields that do
    not fit, numbers that cannot be)."""

    ok: int = 0
    short: int = 0
    huge: int = 0
    foreign: int = 0
    version: int = 0
    unknown: int = 0
    crc: int = 0
    body: int = 0

    @property
    def refused(self) -> int:
        """Datagrams that gave no frame."""
        return (self.short + self.huge + self.foreign + self.version + self.unknown + self.crc
                + self.body)


class Decoder:
    """Opens datagrams and counts those that are no frames."""

    def __init__(self) -> None:
        self.counters = Counters()

    def decode(self, data: bytes) -> Heard | None:
        """The frame in a datagram, None if there is none. Never raises."""
        found = opened(data) if len(data) <= LARGEST else "huge"
        if isinstance(found, Heard):
            self.counters.ok += 1
            return found
        setattr(self.counters, found, getattr(self.counters, found) + 1)
        return None


@lru_cache(maxsize=RECENT)
def opened(data: bytes) -> Heard | str:
    """The frame, or the counter that says what is wrong."""
    end = len(data) - _CRC.size
    if end < HEAD.size:
        return "short"
    magic, version, ident, boot, seq, sent = HEAD.unpack_from(data)
    if magic != MAGIC:
        return "foreign"
    if version != VERSION:
        return "version"
    kind = BY_ID.get(ident)
    if kind is None:
        return "unknown"
    if crc32(data[:end], kind.seed) != _CRC.unpack_from(data, end)[0]:
        return "crc"
    try:
        return Heard(kind, boot, seq, sent * 1e-6, _read(kind, data, end))
    except (ValueError, error):
        return "body"


def _read(kind: Kind, data: bytes, end: int) -> tuple[Any, ...]:
    """Values of a body. Raises ValueError, struct.error."""
    at, values = HEAD.size, []
    for f in kind.fields:
        if f.type in FORMATS:
            found: Any = f.struct.unpack_from(data, at)
            at += f.struct.size
            _possible(f, found)
            found = found if f.count > 1 else found[0]
        else:
            size = data[at] * (f.struct.size if f.type == "rows" else 1)
            part = data[at + 1:at + 1 + size]
            at += 1 + size
            found = _VARIABLE[f.type](f, part, size)
        values.append(found)
        if at > end:
            raise ValueError("the body ends too early")
    if at != end:
        raise ValueError("the body is too long")
    return tuple(values)


def _text(f: Field, part: bytes, size: int) -> str:
    if size > f.count:
        raise ValueError("a text that is too long")
    text = part.decode("utf-8")
    if not text.isprintable() or (f.name == "name" and not text):
        raise ValueError("a text that cannot be shown")
    return text


def _rows(f: Field, part: bytes, size: int) -> tuple[tuple[float, ...], ...]:
    if size > POINTS * f.struct.size:
        raise ValueError("too many rows")
    rows = tuple(f.struct.iter_unpack(part))
    for row in rows:
        _possible(f, row)
    return rows


def _bytes(f: Field, part: bytes, size: int) -> bytes:
    if size > f.count:
        raise ValueError("more bytes than there may be")
    return part


_VARIABLE: dict[str, Callable[[Field, bytes, int], Any]] = {
    "text": _text, "rows": _rows, "bytes": _bytes}


def _possible(f: Field, numbers: tuple[float, ...]) -> None:
    """Raises ValueError for a number that no car tells; NaN is one."""
    if not all(f.low <= v <= f.high and isfinite(v) for v in numbers):
        raise ValueError(f"{f.name} is out of range")


def encode(kind: Kind, boot: int, seq: int, sent: float, values: tuple[Any, ...]) -> bytes:
    """A frame. sent [s] >= 0; values as in ``Heard``. Raises UsageError for what is no value."""
    head = HEAD.pack(MAGIC, VERSION, kind.id, boot, seq & 0xFFFFFFFF, round(sent * 1e6))
    try:
        body = b"".join(_written(f, v) for f, v in zip(kind.fields, values, strict=True))
    except (ValueError, TypeError, error) as why:
        raise UsageError(f"{kind.name}: {why}", found=repr(values),
                         expected=", ".join(f"{f.name} {f.type}" for f in kind.fields)) from why
    data = head + body
    return data + _CRC.pack(crc32(data, kind.seed))


def _written(f: Field, value: Any) -> bytes:
    if f.type in FORMATS:
        numbers = value if f.count > 1 else (value,)
        _possible(f, numbers)
        return f.struct.pack(*numbers)
    if f.type in ("text", "bytes"):
        raw = str(value).encode("utf-8") if f.type == "text" else bytes(value)
        _VARIABLE[f.type](f, raw, len(raw))
        return bytes((len(raw),)) + raw
    rows = [f.struct.pack(*row) for row in value]
    if len(rows) > POINTS:
        raise ValueError(f"{len(rows)} points, at most {POINTS}")
    for row in value:
        _possible(f, row)
    return bytes((len(rows),)) + b"".join(rows)
