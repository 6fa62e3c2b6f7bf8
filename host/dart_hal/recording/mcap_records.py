"""Reads the records of an MCAP file: all that is whole, also behind a damage.

A run that was killed has no index and may end inside a record; a copy may have
lost a sector in the middle. Chunks and attachments carry a checksum: behind a
damage reading goes on at the next one that holds. Runs of version 0.1 have
``seals`` instead.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Container, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from struct import Struct
from struct import error as StructError  # noqa: N812
from typing import Any, NamedTuple
from zlib import crc32

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from zstandard import ZstdError

from dart_hal.core.errors import RecordingError
from dart_hal.recording.expansion import ExpandsTooFar, expand_chunk, expansion_limit
from dart_hal.recording.regular import check_regular
from dart_hal.recording.seals import Block, sealed_blocks

MCAP_MAGIC = b"\x89MCAP0\r\n"
PREFIX = Struct("<BQ")  # opcode, length of what follows
MESSAGE = Struct("<HIQQ")  # channel, sequence, log time, publish time
_INDEX = Struct("<HI")  # channel, length of the entries
_FOOTER = Struct("<BQQQI")  # opcode, length, start of the summary, of its offsets, CRC-32
_U32 = Struct("<I")
# What mcap and the decoders of chunks raise for bytes that are no record; lz4 raises
# RuntimeError.
_UNREADABLE = (StructError, ValueError, McapError, ZstdError, EOFError, MemoryError, OverflowError,
               RuntimeError)
# Where a chunk or an attachment of less than 1 TB may begin. The first byte stands outside of
# the lookahead: it is searched for as fast as a set of characters, 20 times faster.
_CHECKED = re.compile(rb"[\x06\x09](?=.{5}\0{3})", re.DOTALL)

PLAIN: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel,
                         Opcode.METADATA: Metadata}
# What a channel notes: ns since 1970 when the clock of its car was 0.
ZERO = "zero_ns"
# Media types of attachments: facts by name, and the files of the car.
JSON = "application/json"
TOML = "application/toml"
# Attachment by which an imported recording is recognised.
IMPORT_NOTE = "import"


class Damage(NamedTuple):
    """``skipped`` bytes from ``at`` on were not read (0: something is missing there)."""

    at: int
    skipped: int


class McapMessage(NamedTuple):
    """One message: topic, stamp (whole ns, rest), payload."""

    topic: str
    ns: int
    rest: int
    data: bytes


@dataclass
class McapFile:
    """Content of a file: ``blocks`` of whole records, facts by name, channel topics by id.

    ``types``: the message type of each topic, "" where its schema is lost; ``definitions``: text
    of each type.

    ``complete``: the footer and the closing magic are there; ``length``,
    ``used``: bytes of the file and up to the last record that holds; ``damages``:
    what was skipped before that; ``count`` of messages; ``zeros`` by id [ns since 1970]: when the
    clock of the channel's car was 0, where it is not 1970. Stamps given are of that clock.
    ``expanded``: bytes of all chunks without compression; ``oversized``: of a chunk that was
    not read, as it expands too far.
    """

    path: Path
    length: int
    complete: bool
    used: int = len(MCAP_MAGIC)
    damages: list[Damage] = field(default_factory=list)
    blocks: list[bytes] = field(default_factory=list)
    topics: dict[int, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    count: int = 0
    zeros: dict[int, int] = field(default_factory=dict)
    expanded: int = 0
    oversized: str = ""

    def messages(self, topics: Container[str] | None = None) -> Iterator[McapMessage]:
        """Messages of these topics (None: all) in file order."""
        wanted = {n: t for n, t in self.topics.items() if topics is None or t in topics}
        for block in self.blocks:
            for opcode, start, end in records(block):
                if opcode == Opcode.MESSAGE:
                    channel, rest, ns, _ = MESSAGE.unpack_from(block, start)
                    if channel in wanted:
                        yield McapMessage(wanted[channel], ns - self.zeros.get(channel, 0), rest,
                                      block[start + MESSAGE.size:end])

    def extent(self) -> tuple[Counter[str], int, int]:
        """Messages by topic, and the least and the largest stamp [ns]; 0 and 0 without any."""
        counts: Counter[int] = Counter()
        first = 1 << 64
        last = -1 << 64
        for block in self.blocks:
            for opcode, start, _ in records(block):
                if opcode == Opcode.MESSAGE:
                    channel, _, ns, _ = MESSAGE.unpack_from(block, start)
                    if channel in self.topics:
                        counts[channel] += 1
                        ns -= self.zeros.get(channel, 0)
                        first, last = min(first, ns), max(last, ns)
        by_topic = Counter({topic: counts[n] for n, topic in self.topics.items()})
        return (by_topic, first, last) if first <= last else (by_topic, 0, 0)


def read_mcap(path: Path) -> McapFile:
    """Read a file; raises RecordingError that names it when it is no MCAP."""
    return parse_mcap(path, _bytes_of(path))


def parse_mcap(path: Path, data: bytes) -> McapFile:
    """The same of bytes that begin with the magic; ``path`` is for messages."""
    found = McapFile(path, len(data), _has_end(data))
    sealed = sealed_blocks(data)
    if sealed:
        _read_by_seals(data, sealed, found)
    else:
        _read_by_checksums(data, found)
    schemas: dict[int, str] = {}
    for block in found.blocks:
        for opcode, start, end in records(block):
            if opcode == Opcode.MESSAGE:
                found.count += 1
            elif opcode == Opcode.SCHEMA:
                schema = content(Schema, block[start:end])
                schemas[schema.id] = schema.name
                if schema.encoding == "ros2msg":
                    found.definitions[schema.name] = schema.data.decode(errors="replace")
            elif opcode == Opcode.CHANNEL:
                channel = content(Channel, block[start:end])
                found.topics[channel.id] = channel.topic
                found.types[channel.topic] = schemas.get(channel.schema_id, "")
                if channel.metadata.get(ZERO, "").lstrip("-").isdecimal():
                    found.zeros[channel.id] = int(channel.metadata[ZERO])
            elif opcode == Opcode.METADATA:
                noted = content(Metadata, block[start:end])
                found.metadata[noted.name] = noted.metadata
            elif opcode == Opcode.ATTACHMENT:
                _read_attachment(found, content(Attachment, block[start:end]))
    return found


def records(block: bytes) -> Iterator[tuple[int, int, int]]:
    """(opcode, start, end) of the content of each record of a block."""
    at = 0
    while at < len(block):
        opcode, length = PREFIX.unpack_from(block, at)
        start, at = at + PREFIX.size, at + PREFIX.size + length
        yield opcode, start, at


def content(kind: Any, body: bytes) -> Any:
    """A record of mcap's type ``kind`` from its content."""
    return kind.read(ReadDataStream(BytesIO(body)))


def _bytes_of(path: Path) -> bytes:
    check_regular(path)
    try:
        data = path.read_bytes()
    except OSError as why:
        raise RecordingError(f"{path}: cannot be read", found=why.strerror or str(why),
                             read=str(path), remedy="check the path") from why
    if data[:len(MCAP_MAGIC)] != MCAP_MAGIC:
        what = "the file is empty" if not data else f"it begins with {data[:16]!r}"
        raise RecordingError(f"{path}: is not an MCAP recording", found=what,
                             expected=f"a file that begins with {MCAP_MAGIC!r}", read=str(path),
                             likely="another kind of file, or a run that was killed at once",
                             remedy="dart-hal record --out run.mcap")
    return data


def _read_attachment(found: McapFile, attachment: Attachment) -> None:
    """A file of the car, or facts; what other tools attach is none of ours."""
    text = attachment.data.decode(errors="replace")
    if attachment.media_type == TOML:
        found.metadata.setdefault("files", {})[attachment.name] = text
    elif attachment.media_type == JSON:
        try:
            found.metadata[attachment.name] = dict(json.loads(text))
        except (ValueError, TypeError, RecursionError):
            return


def _has_end(data: bytes) -> bool:
    at = len(data) - len(MCAP_MAGIC) - _FOOTER.size
    return (at >= len(MCAP_MAGIC) and data.endswith(MCAP_MAGIC)
            and PREFIX.unpack_from(data, at) == (Opcode.FOOTER, _FOOTER.size - PREFIX.size))


def _read_by_seals(data: bytes, sealed: list[Block], found: McapFile) -> None:
    end, number = 0, 0
    for block in sealed:
        if block.start != end or block.number != number:
            found.damages.append(Damage(end, block.start - end))
        found.blocks.append(data[max(block.start, len(MCAP_MAGIC)):block.end])
        end, number = block.end, block.number + 1
    found.used = end
    if found.complete:
        # Behind the last seal stands the index alone; nothing of it is used.
        if PREFIX.unpack_from(data, end) != (Opcode.DATA_END, _U32.size):
            found.damages.append(Damage(end, len(data) - end))
        found.used = len(data)


def _read_by_checksums(data: bytes, found: McapFile) -> None:
    """``sound``: end of what is trusted; what follows it counts when a checksum holds again."""
    at = sound = len(MCAP_MAGIC)
    plain: set[int] = set()
    while at < len(data):
        opcode, start, end = _read_prefix(data, at)
        block = _read_checked(data, at, found)
        if opcode == Opcode.DATA_END and end == start + _U32.size:
            _check_end(data, at, found)
            return
        if block is None and _is_plain(data, at, plain):
            block = data[at:end]
        if block is not None:
            found.blocks.append(block)
            found.expanded += len(block)
            at = sound = end
        elif _is_index(data, at):
            at = end
        else:
            again = next((m.start() for m in _CHECKED.finditer(data, sound)
                          if _read_checked(data, m.start(), found) is not None), None)
            if plain and found.blocks:  # what is missing may lie inside the record before
                at = sound = sound - len(found.blocks.pop())
                plain.clear()
            if again is None:
                break
            found.damages.append(Damage(sound, again - sound))
            at = again
    found.used = at
    if found.complete:
        found.damages.append(Damage(at, len(data) - at))
        found.used = len(data)


def _read_prefix(data: bytes, at: int) -> tuple[int, int, int]:
    """(opcode, start, end) of the record at ``at``; opcode 0 where there is none."""
    if at + PREFIX.size > len(data):
        return 0, at, at
    opcode, length = PREFIX.unpack_from(data, at)
    start = at + PREFIX.size
    return (opcode, start, start + length) if length <= len(data) - start else (0, at, at)


def _read_checked(data: bytes, at: int, found: McapFile) -> bytes | None:
    """Records of the chunk at ``at``, or the attachment there, if its checksum holds.

    All chunks together may expand as far as the length of the file allows.
    """
    opcode, start, end = _read_prefix(data, at)
    body = data[start:end] if opcode in (Opcode.CHUNK, Opcode.ATTACHMENT) else b""
    try:
        if opcode == Opcode.ATTACHMENT:
            (crc,) = _U32.unpack(body[-4:])
            return data[at:end] if crc == crc32(body[:-4]) else None
        if opcode == Opcode.CHUNK:
            chunk = content(Chunk, body)
            if not chunk.uncompressed_crc or record_bytes(chunk) != data[at:end]:
                return None
            expanded = expand_chunk(chunk.compression, chunk.data, chunk.uncompressed_size,
                                    expansion_limit(len(data)) - found.expanded)
            return expanded if crc32(expanded) == chunk.uncompressed_crc else None
    except ExpandsTooFar as why:
        found.oversized = str(why)
    except _UNREADABLE:
        return None
    return None


def record_bytes(record: Any) -> bytes:
    """The bytes of a record of mcap's."""
    builder = RecordBuilder()
    record.write(builder)
    raw: bytes = builder.end()  # type: ignore[no-untyped-call]
    return raw


def _is_plain(data: bytes, at: int, channels: set[int]) -> bool:
    """Whether a record stands here that other tools write outside of chunks.

    ``channels``: ids of those that stand there as well. A message counts in one of them only:
    one changed bit makes a message out of the index behind a chunk.
    """
    opcode, start, end = _read_prefix(data, at)
    if opcode == Opcode.MESSAGE:
        return end >= start + MESSAGE.size and _INDEX.unpack_from(data, start)[0] in channels
    if opcode not in PLAIN:
        return False
    try:
        record = content(PLAIN[opcode], data[start:end])
        exact = record_bytes(record) == data[at:end]
    except _UNREADABLE:
        return False
    if exact and opcode == Opcode.CHANNEL:
        channels.add(record.id)
    return exact


def _is_index(data: bytes, at: int) -> bool:
    """Whether the header, or the index of one channel of a chunk, stands here."""
    opcode, start, end = _read_prefix(data, at)
    if opcode == Opcode.MESSAGE_INDEX and end >= start + _INDEX.size:
        _, length = _INDEX.unpack_from(data, start)
        return bool(end == start + _INDEX.size + length)
    return opcode == Opcode.HEADER and at == len(MCAP_MAGIC)


def _check_end(data: bytes, at: int, found: McapFile) -> None:
    """The data end at ``at``: is all there that was written, and the index behind it?"""
    found.used = at
    if not found.complete:
        return
    (crc,) = _U32.unpack_from(data, at + PREFIX.size)
    footer = len(data) - len(MCAP_MAGIC) - _FOOTER.size
    _, _, summary, _, summary_crc = _FOOTER.unpack_from(data, footer)
    behind = at + PREFIX.size + _U32.size
    sound = not summary or (summary == behind and summary_crc in (
        0, crc32(data[summary:footer + _FOOTER.size - 4])))
    if not found.damages and not (sound and crc in (0, crc32(data[:at]))):
        found.damages.append(Damage(at, 0))
    if sound and summary:  # it repeats the channels: the chunk that held them may be lost
        found.blocks.insert(0, data[summary:footer])
    found.used = len(data)


def notices(found: McapFile) -> tuple[str, ...]:
    """What the user must know about a file that is not as it was written."""
    told = []
    read = f"read {found.count} whole messages"
    if found.oversized:
        told.append(f"{found.path}: a chunk was not read: {found.oversized}")
    if found.damages:
        places = len(found.damages)
        more = f" and at {places - 1} more place(s)" if places > 1 else ""
        skipped = sum(d.skipped for d in found.damages)
        told.append(f"{found.path}: damaged {'at' if skipped else 'before'} byte "
                    f"{found.damages[0].at}{more}, {skipped} bytes skipped; {read}")
    if not found.complete:
        told.append(f"{found.path}: the end is missing; {read}, "
                    f"{found.length - found.used} bytes were cut off")
    return tuple(told)
