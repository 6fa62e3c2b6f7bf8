"""Reads the records of an MCAP file: all that is whole, also behind a damage.

A run that was killed has no footer and may end inside a record; a copy may
have lost a sector in the middle. ``mcap_walk`` says which records to trust.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from struct import Struct, error
from typing import NamedTuple

from mcap.exceptions import McapError

from dart_hal.errors import RecordingError
from dart_hal.recording.mcap_walk import (
    CHANNEL,
    CHUNK,
    MAGIC,
    MESSAGE,
    METADATA,
    PREFIX,
    Damage,
    walk,
)

_MESSAGE = Struct("<HIQQ")
_U16, _U32 = Struct("<H"), Struct("<I")


class Message(NamedTuple):
    """One message: topic, stamp (whole ns, rest), payload."""

    topic: str
    ns: int
    rest: int
    data: bytes


@dataclass
class McapFile:
    """Content of a file: messages in file order, metadata by name, channel topics.

    ``complete``: the footer and the closing magic are there; ``length``,
    ``used``: bytes of the file and up to the last whole record; ``damages``:
    what was skipped before that.
    """

    path: Path
    length: int
    used: int = 0
    complete: bool = False
    damages: list[Damage] = field(default_factory=list)
    topics: dict[int, str] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)


def read_mcap(path: Path) -> McapFile:
    """Read a file; raises RecordingError that names it when it is no MCAP."""
    return parse_mcap(path, _bytes_of(path))


def parse_mcap(path: Path, data: bytes) -> McapFile:
    """The same of bytes that begin with the magic; ``path`` is for messages."""
    trusted = walk(data)
    found = McapFile(path, len(data), trusted.used, trusted.complete, trusted.damages)
    for record in trusted.records:
        body = data[record.start:record.end]
        try:
            if record.opcode == CHUNK:
                _chunk(found, body)
            else:
                _enter(found, record.opcode, body)
        except (error, ValueError, LookupError, EOFError, McapError):
            start = record.start - PREFIX.size
            found.damages.append(Damage(start, record.end - start))
    found.damages.sort()
    return found


def _bytes_of(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as why:
        raise RecordingError(f"{path}: cannot be read", found=why.strerror or str(why),
                             read=str(path), remedy="check the path") from why
    if data[:len(MAGIC)] != MAGIC:
        what = "the file is empty" if not data else f"it begins with {data[:16]!r}"
        raise RecordingError(f"{path}: is not an MCAP recording", found=what,
                             expected=f"a file that begins with {MAGIC!r}", read=str(path),
                             likely="another kind of file, or a run that was killed at once",
                             remedy="dart-hal record --out run.mcap")
    return data


def _enter(found: McapFile, opcode: int, body: bytes) -> None:
    if opcode == MESSAGE:
        channel, rest, ns, _ = _MESSAGE.unpack_from(body)
        found.messages.append(Message(found.topics[channel], ns, rest, body[_MESSAGE.size:]))
    elif opcode == CHANNEL:
        (ident,) = _U16.unpack_from(body)
        found.topics[ident], _ = _string(body, 4)
    elif opcode == METADATA:
        name, at = _string(body, 0)
        found.metadata[name] = _map(body, at)


def _chunk(found: McapFile, body: bytes) -> None:
    """Messages inside a chunk: files that another tool has rewritten."""
    from mcap.data_stream import ReadDataStream, RecordBuilder
    from mcap.records import Chunk
    from mcap.stream_reader import breakup_chunk

    for record in breakup_chunk(Chunk.read(ReadDataStream(BytesIO(body))), validate_crc=True):
        builder = RecordBuilder()
        record.write(builder)
        raw: bytes = builder.end()  # type: ignore[no-untyped-call]
        _enter(found, raw[0], raw[PREFIX.size:])


def _string(body: bytes, at: int) -> tuple[str, int]:
    (length,) = _U32.unpack_from(body, at)
    end = at + 4 + length
    if end > len(body):
        raise ValueError(f"a text of {length} bytes in a record of {len(body)}")
    return body[at + 4:end].decode(), end


def _map(body: bytes, at: int) -> dict[str, str]:
    (length,) = _U32.unpack_from(body, at)
    at += 4
    end = at + length
    result = {}
    while at < end:
        key, at = _string(body, at)
        result[key], at = _string(body, at)
    return result
