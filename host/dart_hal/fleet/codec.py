"""From values to frames and back, without I/O. ``Decoder`` never raises, whatever comes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from math import isfinite
from struct import Struct, error
from typing import Any, NamedTuple
from zlib import crc32

from dart_hal.core.errors import UsageError
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.messages import (
    BY_ID,
    FORMATS,
    HEAD,
    LARGEST,
    MAGIC,
    POINTS,
    ROW_FORMATS,
    SIGNATURE_BYTES,
    SIGNED_VERSION,
    VERSION,
    Field,
    Kind,
)

_CRC = Struct("<I")
RECENT = 512
"""Frames whose values are kept: cars of one process then decode a frame once, not each for
itself."""
MAX_IGNORED = 64
"""Names in ``Decoder.ignored``: a flood of names must not fill the memory."""
REASONS = {
    "unsigned": "its messages are not signed: start it with the key of this room",
    "forged": "its signature is not of this room's key",
    "signed": "its messages are signed: this program was started without the room's key",
}
"""Why a frame with a readable name is ignored, by counter."""


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
    not fit, numbers that cannot be); in a room with a key unsigned and forged (signed with
    another key, or changed on the way), in one without a key signed."""

    ok: int = 0
    short: int = 0
    huge: int = 0
    foreign: int = 0
    version: int = 0
    unknown: int = 0
    crc: int = 0
    body: int = 0
    unsigned: int = 0
    forged: int = 0
    signed: int = 0

    @property
    def refused(self) -> int:
        """Datagrams that gave no frame."""
        counts: dict[str, int] = asdict(self)
        return sum(counts.values()) - self.ok


class Decoder:
    """Opens datagrams and counts those that are no frames.

    key: of the room; with one, only frames that it has signed are returned. ``ignored``: by the
    name in a frame, why its frames were not accepted. That name is not verified.
    """

    def __init__(self, key: RoomKey | None = None) -> None:
        self.key = key
        self.counters = Counters()
        self.ignored: dict[str, str] = {}

    def decode(self, data: bytes) -> Heard | None:
        """The frame in a datagram, None if there is none. Never raises."""
        found = opened(data, self.key) if len(data) <= LARGEST else "huge"
        if isinstance(found, Heard):
            self.counters.ok += 1
            return found
        setattr(self.counters, found, getattr(self.counters, found) + 1)
        if found in REASONS and len(self.ignored) < MAX_IGNORED:
            claimed = parse(data, VERSION if found == "unsigned" else SIGNED_VERSION)
            if isinstance(claimed, Heard):
                self.ignored[claimed.name] = REASONS[found]
        return None


@lru_cache(maxsize=RECENT)
def opened(data: bytes, key: RoomKey | None = None) -> Heard | str:
    """The frame, or the counter that says what is wrong.

    With a key the signature is verified before anything but the version is looked at.
    """
    if len(data) < HEAD.size:
        return "short"
    if data[:2] != MAGIC:
        return "foreign"
    version = data[2]
    if version not in (VERSION, SIGNED_VERSION):
        return "version"
    if key is None:
        return parse(data, VERSION) if version == VERSION else "signed"
    if version == VERSION:
        return "unsigned"
    if not key.verify(data):
        return "forged"
    return parse(data, SIGNED_VERSION)


def parse(data: bytes, version: int) -> Heard | str:
    """The frame of this version, or the counter of what is wrong. Signatures are not verified."""
    if version == SIGNED_VERSION:
        data = data[:-SIGNATURE_BYTES]
    end = len(data) - _CRC.size
    if end < HEAD.size:
        return "short"
    _, _, ident, boot, seq, sent = HEAD.unpack_from(data)
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
            size = data[at] * (f.struct.size if f.type in ROW_FORMATS else 1)
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


def _rows(f: Field, part: bytes, size: int) -> tuple[tuple[Any, ...], ...]:
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
    "text": _text, "rows": _rows, "pairs": _rows, "bytes": _bytes}


def _possible(f: Field, numbers: tuple[float, ...]) -> None:
    """Raises ValueError for a number that no car tells; NaN is one."""
    if not all(f.low <= v <= f.high and isfinite(v) for v in numbers):
        raise ValueError(f"{f.name} is out of range")


def encode(kind: Kind, boot: int, seq: int, sent: float, values: tuple[Any, ...],
           key: RoomKey | None = None) -> bytes:
    """A frame, signed where a key is given. sent [s] >= 0; values as in ``Heard``.

    Raises UsageError for what is no value.
    """
    version = VERSION if key is None else SIGNED_VERSION
    head = HEAD.pack(MAGIC, version, kind.id, boot, seq & 0xFFFFFFFF, round(sent * 1e6))
    try:
        body = b"".join(_written(f, v) for f, v in zip(kind.fields, values, strict=True))
    except (ValueError, TypeError, error) as why:
        raise UsageError(f"{kind.name}: {why}", found=repr(values),
                         expected=", ".join(f"{f.name} {f.type}" for f in kind.fields)) from why
    data = head + body
    data += _CRC.pack(crc32(data, kind.seed))
    return data if key is None else data + key.signature(data)


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
