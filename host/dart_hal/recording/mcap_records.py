"""Reader of MCAP records that recovers all complete records of a damaged file.

A run that was killed has no index and may end inside a record; a copy may lack a sector in the
middle. Chunks and attachments have a checksum: after damaged bytes, reading continues at the next
record with a correct checksum. Runs of version 0.1 have ``seals`` instead.
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
from dart_hal.recording.items import JSON, TOML, ZERO
from dart_hal.recording.regular import check_regular
from dart_hal.recording.seals import Block, find_sealed_blocks

MCAP_MAGIC = b"\x89MCAP0\r\n"
PREFIX = Struct("<BQ")  # opcode, length of the content
MESSAGE = Struct("<HIQQ")  # channel, sequence, log time, publish time
_INDEX = Struct("<HI")  # channel, length of the entries
_FOOTER = Struct("<BQQQI")  # opcode, length, start of the summary, of its offsets, CRC-32
_U32 = Struct("<I")
# Exceptions of mcap and of the decompressors for bytes that are no record; lz4 raises RuntimeError.
_UNREADABLE = (StructError, ValueError, McapError, ZstdError, EOFError, MemoryError, OverflowError,
               RuntimeError)
# Possible start of a chunk or an attachment of less than 1 TB: the opcode, and three zeros at the
# end of the length. The first byte is outside of the lookahead, so that the regular expression
# searches for a set of characters, which is 20 times faster.
_CHECKED = re.compile(rb"[\x06\x09](?=.{5}\0{3})", re.DOTALL)

PLAIN: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel,
                         Opcode.METADATA: Metadata}


class Damage(NamedTuple):
    """``skipped`` bytes from ``offset`` on were not read; 0: bytes are missing there."""

    offset: int
    skipped: int


class McapMessage(NamedTuple):
    """One message: topic, stamp (whole ns, rest), payload."""

    topic: str
    ns: int
    rest: int
    data: bytes


@dataclass
class McapFile:
    """Content of an MCAP file.

    length: bytes of the file. complete: it has the footer and the closing magic. used: bytes up to
    the end of the last valid record. damages: bytes that were skipped before that. blocks: complete
    records, one or several in a block. topics: by channel id. types: message type by topic, "" if
    its schema is lost. definitions: text by message type. metadata: facts by name, and the files
    of the car. count: of messages. zeros [ns since 1970]: by channel id, the zero of the clock of
    its car if that is not 1970; stamps are returned on that clock. expanded: bytes of all chunks
    without compression. oversized: message about a chunk that expands too far and was not read.
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
        """Yield the messages of these topics (None: all) in file order."""
        selected = {n: t for n, t in self.topics.items() if topics is None or t in topics}
        for block in self.blocks:
            for opcode, start, end in iterate_records(block):
                if opcode == Opcode.MESSAGE:
                    channel, rest, ns, _ = MESSAGE.unpack_from(block, start)
                    if channel in selected:
                        yield McapMessage(selected[channel], ns - self.zeros.get(channel, 0), rest,
                                          block[start + MESSAGE.size:end])

    def extent(self) -> tuple[Counter[str], int, int]:
        """Return the number of messages by topic, the smallest and the largest stamp [ns]."""
        counts: Counter[int] = Counter()
        first = 1 << 64
        last = -1 << 64
        for block in self.blocks:
            for opcode, start, _ in iterate_records(block):
                if opcode == Opcode.MESSAGE:
                    channel, _, ns, _ = MESSAGE.unpack_from(block, start)
                    if channel in self.topics:
                        counts[channel] += 1
                        ns -= self.zeros.get(channel, 0)
                        first = min(first, ns)
                        last = max(last, ns)
        by_topic = Counter({topic: counts[n] for n, topic in self.topics.items()})
        return (by_topic, first, last) if first <= last else (by_topic, 0, 0)


def read_mcap(path: Path) -> McapFile:
    """Read a file. Raises RecordingError if it is no MCAP file."""
    return parse_mcap(path, _read_bytes(path))


def parse_mcap(path: Path, data: bytes) -> McapFile:
    """Parse the bytes of a file, which begin with the magic; ``path`` is for messages.

    1. Find the complete records, by seals (version 0.1) or by checksums.
    2. Collect schemas, channels, facts and files from them.
    """
    found = McapFile(path, len(data), _has_end(data))
    sealed = find_sealed_blocks(data)
    if sealed:
        _read_by_seals(data, sealed, found)
    else:
        _read_by_checksums(data, found)
    schemas: dict[int, str] = {}
    for block in found.blocks:
        for opcode, start, end in iterate_records(block):
            if opcode == Opcode.MESSAGE:
                found.count += 1
            elif opcode == Opcode.SCHEMA:
                schema = parse_record(Schema, block[start:end])
                schemas[schema.id] = schema.name
                if schema.encoding == "ros2msg":
                    found.definitions[schema.name] = schema.data.decode(errors="replace")
            elif opcode == Opcode.CHANNEL:
                channel = parse_record(Channel, block[start:end])
                found.topics[channel.id] = channel.topic
                found.types[channel.topic] = schemas.get(channel.schema_id, "")
                if channel.metadata.get(ZERO, "").lstrip("-").isdecimal():
                    found.zeros[channel.id] = int(channel.metadata[ZERO])
            elif opcode == Opcode.METADATA:
                facts = parse_record(Metadata, block[start:end])
                found.metadata[facts.name] = facts.metadata
            elif opcode == Opcode.ATTACHMENT:
                _read_attachment(found, parse_record(Attachment, block[start:end]))
    return found


def iterate_records(block: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) of the content of each record of a block."""
    offset = 0
    while offset < len(block):
        opcode, length = PREFIX.unpack_from(block, offset)
        start = offset + PREFIX.size
        offset = start + length
        yield opcode, start, offset


def parse_record(kind: Any, body: bytes) -> Any:
    """Parse the content of a record as the type ``kind`` of mcap."""
    return kind.read(ReadDataStream(BytesIO(body)))


def _read_bytes(path: Path) -> bytes:
    """Return the bytes of a file. Raises RecordingError if it does not begin with the magic."""
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
    """Add a file of the car, or facts; ignore attachments of other tools."""
    text = attachment.data.decode(errors="replace")
    if attachment.media_type == TOML:
        found.metadata.setdefault("files", {})[attachment.name] = text
    elif attachment.media_type == JSON:
        try:
            found.metadata[attachment.name] = dict(json.loads(text))
        except (ValueError, TypeError, RecursionError):
            return


def _has_end(data: bytes) -> bool:
    """Return whether a file ends with a footer and the magic."""
    offset = len(data) - len(MCAP_MAGIC) - _FOOTER.size
    return (offset >= len(MCAP_MAGIC) and data.endswith(MCAP_MAGIC)
            and PREFIX.unpack_from(data, offset) == (Opcode.FOOTER, _FOOTER.size - PREFIX.size))


def _read_by_seals(data: bytes, sealed: list[Block], found: McapFile) -> None:
    """Take the blocks with a correct seal; a gap in bytes or numbers is a damage."""
    end = 0
    number = 0
    for block in sealed:
        if block.start != end or block.number != number:
            found.damages.append(Damage(end, block.start - end))
        found.blocks.append(data[max(block.start, len(MCAP_MAGIC)):block.end])
        end = block.end
        number = block.number + 1
    found.used = end
    if found.complete:
        # Only the index follows the last seal; it is not used.
        if PREFIX.unpack_from(data, end) != (Opcode.DATA_END, _U32.size):
            found.damages.append(Damage(end, len(data) - end))
        found.used = len(data)


def _read_by_checksums(data: bytes, found: McapFile) -> None:
    """Take the records that are certainly complete, and continue after damaged bytes.

    1. A chunk or attachment is taken if its checksum is correct.
    2. A record that other tools write outside of chunks has no checksum. It is taken if it is
       exactly what mcap would write. Its bytes may still hide a gap, so it is removed again if
       the next record is damaged.
    3. The index of a chunk is skipped.
    4. Otherwise the bytes are damaged: continue at the next correct checksum.

    ``sound`` is the end of the trusted bytes.
    """
    offset = sound = len(MCAP_MAGIC)
    plain: set[int] = set()
    while offset < len(data):
        opcode, start, end = _read_prefix(data, offset)
        block = _read_checked(data, offset, found)
        if opcode == Opcode.DATA_END and end == start + _U32.size:
            _check_end(data, offset, found)
            return
        if block is None and _is_plain(data, offset, plain):
            block = data[offset:end]
        if block is not None:
            found.blocks.append(block)
            found.expanded += len(block)
            offset = sound = end
        elif _is_index(data, offset):
            offset = end
        else:
            again = next((m.start() for m in _CHECKED.finditer(data, sound)
                          if _read_checked(data, m.start(), found) is not None), None)
            if plain and found.blocks:  # the missing bytes may be inside the last record
                offset = sound = sound - len(found.blocks.pop())
                plain.clear()
            if again is None:
                break
            found.damages.append(Damage(sound, again - sound))
            offset = again
    found.used = offset
    if found.complete:
        found.damages.append(Damage(offset, len(data) - offset))
        found.used = len(data)


def _read_prefix(data: bytes, offset: int) -> tuple[int, int, int]:
    """Return (opcode, start, end) of the record at ``offset``; opcode 0 if there is none."""
    if offset + PREFIX.size > len(data):
        return 0, offset, offset
    opcode, length = PREFIX.unpack_from(data, offset)
    start = offset + PREFIX.size
    return (opcode, start, start + length) if length <= len(data) - start else (0, offset, offset)


def _read_checked(data: bytes, offset: int, found: McapFile) -> bytes | None:
    """Return the records of a chunk, or an attachment, if its checksum is correct, else None.

    All chunks together may expand up to ``expansion_limit`` of the length of the file.
    """
    opcode, start, end = _read_prefix(data, offset)
    body = data[start:end] if opcode in (Opcode.CHUNK, Opcode.ATTACHMENT) else b""
    try:
        if opcode == Opcode.ATTACHMENT:
            (crc,) = _U32.unpack(body[-4:])
            return data[offset:end] if crc == crc32(body[:-4]) else None
        if opcode == Opcode.CHUNK:
            chunk = parse_record(Chunk, body)
            if not chunk.uncompressed_crc or record_bytes(chunk) != data[offset:end]:
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
    """Return the bytes of a record of mcap."""
    builder = RecordBuilder()
    record.write(builder)
    raw: bytes = builder.end()  # type: ignore[no-untyped-call]
    return raw


def _is_plain(data: bytes, offset: int, channels: set[int]) -> bool:
    """Return whether a record that other tools write outside of chunks begins at ``offset``.

    ``channels``: ids of channels outside of chunks; a channel found here is added. A message
    counts only in one of them: one changed bit turns the index after a chunk into a message.
    """
    opcode, start, end = _read_prefix(data, offset)
    if opcode == Opcode.MESSAGE:
        return end >= start + MESSAGE.size and _INDEX.unpack_from(data, start)[0] in channels
    if opcode not in PLAIN:
        return False
    try:
        record = parse_record(PLAIN[opcode], data[start:end])
        exact = record_bytes(record) == data[offset:end]
    except _UNREADABLE:
        return False
    if exact and opcode == Opcode.CHANNEL:
        channels.add(record.id)
    return exact


def _is_index(data: bytes, offset: int) -> bool:
    """Return whether the header, or the index of one channel of a chunk, begins at ``offset``."""
    opcode, start, end = _read_prefix(data, offset)
    if opcode == Opcode.MESSAGE_INDEX and end >= start + _INDEX.size:
        _, length = _INDEX.unpack_from(data, start)
        return bool(end == start + _INDEX.size + length)
    return opcode == Opcode.HEADER and offset == len(MCAP_MAGIC)


def _check_end(data: bytes, offset: int, found: McapFile) -> None:
    """Check the end of the data at ``offset``, and the summary after it.

    The checksum of the data must be correct or absent, and so must that of the summary.
    """
    found.used = offset
    if not found.complete:
        return
    (crc,) = _U32.unpack_from(data, offset + PREFIX.size)
    footer = len(data) - len(MCAP_MAGIC) - _FOOTER.size
    _, _, summary, _, summary_crc = _FOOTER.unpack_from(data, footer)
    summary_start = offset + PREFIX.size + _U32.size
    sound = not summary or (summary == summary_start and summary_crc in (
        0, crc32(data[summary:footer + _FOOTER.size - 4])))
    if not found.damages and not (sound and crc in (0, crc32(data[:offset]))):
        found.damages.append(Damage(offset, 0))
    if sound and summary:  # it repeats the channels, whose chunk may be lost
        found.blocks.insert(0, data[summary:footer])
    found.used = len(data)


def notices(found: McapFile) -> tuple[str, ...]:
    """Return the messages for the user about damaged, missing and oversized parts."""
    messages = []
    read = f"read {found.count} whole messages"
    if found.oversized:
        messages.append(f"{found.path}: a chunk was not read: {found.oversized}")
    if found.damages:
        places = len(found.damages)
        more = f" and at {places - 1} more place(s)" if places > 1 else ""
        skipped = sum(d.skipped for d in found.damages)
        messages.append(f"{found.path}: damaged {'at' if skipped else 'before'} byte "
                        f"{found.damages[0].offset}{more}, {skipped} bytes skipped; {read}")
    if not found.complete:
        messages.append(f"{found.path}: the end is missing; {read}, "
                        f"{found.length - found.used} bytes were cut off")
    return tuple(messages)
