"""Reads the records of an MCAP file, up to the last whole one.

A run that was killed has no footer and may end inside a record. What stands
before is good: records carry their length, so the cut is found exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from struct import Struct, error
from typing import NamedTuple

from mcap.exceptions import McapError

from dart_hal.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 1, 2, 4, 5, 6, 0x0C, 0x0F
_PREFIX = Struct("<BQ")
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

    ``complete``: the closing magic is there; ``length``, ``used``: bytes of
    the file and bytes in whole records.
    """

    path: Path
    length: int
    used: int = 0
    complete: bool = False
    topics: dict[int, str] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)


def read_mcap(path: Path) -> McapFile:
    """Read a file; raises RecordingError that names it when it is no MCAP."""
    return parse_mcap(path, _bytes_of(path))


def parse_mcap(path: Path, data: bytes) -> McapFile:
    """The same of bytes that begin with the magic; ``path`` is for messages."""
    found = McapFile(path, len(data), len(MAGIC))
    try:
        for opcode, start, end in _records(data):
            if opcode == CHUNK:
                _chunk(found, data[start:end])
            else:
                _enter(found, opcode, data[start:end])
            found.used = end
            if opcode == FOOTER:
                found.complete = data[end:] == MAGIC
                break
    except (error, ValueError, LookupError, EOFError, McapError) as why:
        raise RecordingError(f"{path}: a record is damaged", found=repr(why), read=str(path),
                             likely="the file was changed or copied badly") from why
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


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """(opcode, start, end) of every whole record of the data section."""
    at, size = len(MAGIC), len(data)
    while at + _PREFIX.size <= size:
        opcode, length = _PREFIX.unpack_from(data, at)
        start = at + _PREFIX.size
        at = start + length
        if at > size:
            return
        yield opcode, start, at


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

    for record in breakup_chunk(Chunk.read(ReadDataStream(BytesIO(body)))):
        builder = RecordBuilder()
        record.write(builder)
        raw: bytes = builder.end()  # type: ignore[no-untyped-call]
        _enter(found, raw[0], raw[_PREFIX.size:])


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
