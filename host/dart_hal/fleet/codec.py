"""Encoding and decoding of frames, without I/O. ``Decoder`` accepts any bytes and never raises."""

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
    MAGIC,
    MAX_FRAME_BYTES,
    MAX_ROWS,
    ROW_FORMATS,
    SIGNATURE_BYTES,
    SIGNED_VERSION,
    VERSION,
    Field,
    Kind,
)

_CRC = Struct("<I")
# Frames whose values are cached: cars of one process decode a frame once, not once each.
MAX_CACHED_FRAMES = 512
# Names in ``Decoder.ignored``, so that a flood of names cannot fill the memory.
MAX_IGNORED = 64
# Reason why a frame with a readable name is ignored, by counter.
REASONS = {
    "unsigned": "its messages are not signed: start it with the key of this room",
    "forged": "its signature is not of this room's key",
    "signed": "its messages are signed: this program was started without the room's key",
}


class ReceivedFrame(NamedTuple):
    """One valid frame. values: in the order of ``kind.fields``; a count > 1 and rows as tuples."""

    kind: Kind
    boot: int
    seq: int
    sent: float
    values: tuple[Any, ...]

    @property
    def name(self) -> str:
        """Name of the sender."""
        return str(self.values[0])


@dataclass
class FrameCounters:
    """Numbers of datagrams by result.

    ok: frames returned. The others by the first fault: short, huge (more than
    ``MAX_FRAME_BYTES``), foreign (another protocol), version, unknown (kind), crc, body (fields
    that do not fit, values out of range); in a room with a key unsigned and forged (signed with
    another key, or changed), in one without a key signed.
    """

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
        """Number of datagrams without a valid frame."""
        counts: dict[str, int] = asdict(self)
        return sum(counts.values()) - self.ok


class Decoder:
    """Decodes datagrams and counts the invalid ones.

    key: of the room; with one, only frames that it has signed are returned. ``ignored``: by the
    name in a frame, the reason why its frames were not accepted. That name is not verified.
    """

    def __init__(self, key: RoomKey | None = None) -> None:
        self.key = key
        self.counters = FrameCounters()
        self.ignored: dict[str, str] = {}

    def decode(self, data: bytes) -> ReceivedFrame | None:
        """Return the frame in a datagram, None if it is invalid. Never raises."""
        found = decode_frame(data, self.key) if len(data) <= MAX_FRAME_BYTES else "huge"
        if isinstance(found, ReceivedFrame):
            self.counters.ok += 1
            return found
        setattr(self.counters, found, getattr(self.counters, found) + 1)
        if found in REASONS and len(self.ignored) < MAX_IGNORED:
            claimed = parse_frame(data, VERSION if found == "unsigned" else SIGNED_VERSION)
            if isinstance(claimed, ReceivedFrame):
                self.ignored[claimed.name] = REASONS[found]
        return None


@lru_cache(maxsize=MAX_CACHED_FRAMES)
def decode_frame(data: bytes, key: RoomKey | None = None) -> ReceivedFrame | str:
    """Return the frame, or the name of the counter of its fault.

    With a key the signature is verified before anything but the version is read.
    """
    if len(data) < HEAD.size:
        return "short"
    if data[:2] != MAGIC:
        return "foreign"
    version = data[2]
    if version not in (VERSION, SIGNED_VERSION):
        return "version"
    if key is None:
        return parse_frame(data, VERSION) if version == VERSION else "signed"
    if version == VERSION:
        return "unsigned"
    if not key.verify(data):
        return "forged"
    return parse_frame(data, SIGNED_VERSION)


def parse_frame(data: bytes, version: int) -> ReceivedFrame | str:
    """Return the frame of this version, or the counter of its fault; verifies no signature."""
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
        return ReceivedFrame(kind, boot, seq, sent * 1e-6, _decode_body(kind, data, end))
    except (ValueError, error):
        return "body"


def _decode_body(kind: Kind, data: bytes, end: int) -> tuple[Any, ...]:
    """Decode the values of a body. Raises ValueError, struct.error."""
    offset = HEAD.size
    values = []
    for f in kind.fields:
        if f.type in FORMATS:
            found: Any = f.struct.unpack_from(data, offset)
            offset += f.struct.size
            _check_range(f, found)
            found = found if f.count > 1 else found[0]
        else:
            size = data[offset] * (f.struct.size if f.type in ROW_FORMATS else 1)
            content = data[offset + 1:offset + 1 + size]
            offset += 1 + size
            found = _VARIABLE[f.type](f, content, size)
        values.append(found)
        if offset > end:
            raise ValueError("the body ends too early")
    if offset != end:
        raise ValueError("the body is too long")
    return tuple(values)


def _decode_text(f: Field, part: bytes, size: int) -> str:
    if size > f.count:
        raise ValueError("a text that is too long")
    text = part.decode("utf-8")
    if not text.isprintable() or (f.name == "name" and not text):
        raise ValueError("a text that cannot be shown")
    return text


def _decode_rows(f: Field, part: bytes, size: int) -> tuple[tuple[Any, ...], ...]:
    if size > MAX_ROWS * f.struct.size:
        raise ValueError("too many rows")
    rows = tuple(f.struct.iter_unpack(part))
    for row in rows:
        _check_range(f, row)
    return rows


def _decode_bytes(f: Field, part: bytes, size: int) -> bytes:
    if size > f.count:
        raise ValueError("more bytes than there may be")
    return part


_VARIABLE: dict[str, Callable[[Field, bytes, int], Any]] = {
    "text": _decode_text, "rows": _decode_rows, "pairs": _decode_rows, "bytes": _decode_bytes}


def _check_range(f: Field, numbers: tuple[float, ...]) -> None:
    """Raise ValueError for a number outside the range of the field, or NaN."""
    if not all(f.low <= v <= f.high and isfinite(v) for v in numbers):
        raise ValueError(f"{f.name} is out of range")


def encode(kind: Kind, boot: int, seq: int, sent: float, values: tuple[Any, ...],
           key: RoomKey | None = None) -> bytes:
    """Encode a frame, signed if a key is given. sent [s] >= 0; values as in ``ReceivedFrame``.

    Raises UsageError for invalid values.
    """
    version = VERSION if key is None else SIGNED_VERSION
    head = HEAD.pack(MAGIC, version, kind.id, boot, seq & 0xFFFFFFFF, round(sent * 1e6))
    try:
        body = b"".join(_encode_field(f, v) for f, v in zip(kind.fields, values, strict=True))
    except (ValueError, TypeError, error) as why:
        raise UsageError(f"{kind.name}: {why}", found=repr(values),
                         expected=", ".join(f"{f.name} {f.type}" for f in kind.fields)) from why
    data = head + body
    data += _CRC.pack(crc32(data, kind.seed))
    return data if key is None else data + key.signature(data)


def _encode_field(f: Field, value: Any) -> bytes:
    if f.type in FORMATS:
        numbers = value if f.count > 1 else (value,)
        _check_range(f, numbers)
        return f.struct.pack(*numbers)
    if f.type in ("text", "bytes"):
        raw = str(value).encode("utf-8") if f.type == "text" else bytes(value)
        _VARIABLE[f.type](f, raw, len(raw))
        return bytes((len(raw),)) + raw
    rows = [f.struct.pack(*row) for row in value]
    if len(rows) > MAX_ROWS:
        raise ValueError(f"{len(rows)} points, at most {MAX_ROWS}")
    for row in value:
        _check_range(f, row)
    return bytes((len(rows),)) + b"".join(rows)
