"""Which records of an MCAP file can be trusted: up to a damage, and again behind it.

Sealed files (``seals``) are read by their seals. In others a record's length
leads to the next one; behind a damage the next chain of three records that
hang together is looked for, and the record before the damage is dropped: what
is missing may lie inside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from struct import Struct
from typing import NamedTuple

from dart_hal.recording.seals import Block, sealed_blocks

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 1, 2, 4, 5, 6, 0x0C, 0x0F
PREFIX = Struct("<BQ")
_LEAST = {HEADER: 8, FOOTER: 20, 3: 14, CHANNEL: 16, MESSAGE: 22, CHUNK: 40, METADATA: 8,
          DATA_END: 4}
_U16 = Struct("<H")
_FOOTER_SIZE, _PRIVATE = 20, 0x80
CHAIN = 3
_LARGEST = 1 << 28  # bytes; a longer record is a damaged length


class Record(NamedTuple):
    """One record: opcode, content from ``start`` to ``end``; its prefix stands before."""

    opcode: int
    start: int
    end: int


class Damage(NamedTuple):
    """``skipped`` bytes from ``at`` on were not read (0: whole blocks are missing there)."""

    at: int
    skipped: int


@dataclass
class Walk:
    """Records to trust in file order, damages, bytes up to the last of them, end present."""

    records: list[Record] = field(default_factory=list)
    damages: list[Damage] = field(default_factory=list)
    used: int = len(MAGIC)
    complete: bool = False


def walk(data: bytes) -> Walk:
    """The records of a file that begins with the magic."""
    found = Walk(complete=_has_end(data))
    blocks = sealed_blocks(data)
    if blocks:
        _by_seals(data, blocks, found)
    else:
        _by_lengths(data, found)
    return found


def _has_end(data: bytes) -> bool:
    at = len(data) - len(MAGIC) - _FOOTER_SIZE - PREFIX.size
    return (at >= len(MAGIC) and data.endswith(MAGIC)
            and data[at:at + PREFIX.size] == PREFIX.pack(FOOTER, _FOOTER_SIZE))


def _by_seals(data: bytes, blocks: list[Block], found: Walk) -> None:
    end, number = 0, 0
    for block in blocks:
        if block.start != end or block.number != number:
            found.damages.append(Damage(end, block.start - end))
        found.records += _chain(data, max(block.start, len(MAGIC)), block.end)
        end, number = block.end, block.number + 1
    found.used = end
    if found.complete:
        # Behind the last seal stands the index alone; nothing of it is used.
        if PREFIX.pack(DATA_END, 4) != data[end:end + PREFIX.size]:
            found.damages.append(Damage(end, len(data) - end))
        found.used = len(data)


def _chain(data: bytes, at: int, end: int) -> Iterator[Record]:
    while at < end:
        opcode, length = PREFIX.unpack_from(data, at)
        start, at = at + PREFIX.size, at + PREFIX.size + length
        yield Record(opcode, start, at)


def _by_lengths(data: bytes, found: Walk) -> None:
    channels: set[int] = set()
    at, size = len(MAGIC), len(data)
    while at < size:
        record = _record(data, at, None)
        if record is not None:
            if record.opcode == CHANNEL:
                channels.add(_U16.unpack_from(data, record.start)[0])
            found.records.append(record)
            found.used = at = record.end
            if record.opcode == FOOTER:
                return
            continue
        # What is missing may lie inside the record before, and what is there too.
        before = found.records[-1].start - PREFIX.size if found.records else at
        again = _resynchronise(data, before, lambda n: n in channels)
        if again is None and _may_be_cut(data, at):
            return
        if found.records:
            found.records.pop()
        found.used = before
        if again is None:
            return
        found.damages.append(Damage(before, again - before))
        at = again


def _record(data: bytes, at: int, known: Callable[[int], bool] | None) -> Record | None:
    """The record at ``at`` if there can be one; ``known`` judges channels, None: any."""
    if at + PREFIX.size > len(data):
        return None
    opcode, length = PREFIX.unpack_from(data, at)
    start = at + PREFIX.size
    if (not HEADER <= opcode <= DATA_END and opcode < _PRIVATE) or length > len(data) - start:
        return None
    if length < _LEAST.get(opcode, 0):
        return None
    if opcode == MESSAGE and known is not None and not known(_U16.unpack_from(data, start)[0]):
        return None
    return Record(opcode, start, start + length)


def _may_be_cut(data: bytes, at: int) -> bool:
    """Whether the bytes at the end can be the first part of a record."""
    head = data[at:at + PREFIX.size]
    if not HEADER <= head[0] <= DATA_END and head[0] < _PRIVATE:
        return False
    if len(head) < PREFIX.size:
        return True
    return bool(len(data) - at - PREFIX.size < PREFIX.unpack(head)[1] < _LARGEST)


def _resynchronise(data: bytes, at: int, known: Callable[[int], bool]) -> int | None:
    """Where the next ``CHAIN`` records hang together, or fewer that end with the file."""
    for start in range(at + 1, len(data) - PREFIX.size + 1):
        place: int = start
        for _ in range(CHAIN):
            record = _record(data, place, known)
            if record is None or record.opcode >= _PRIVATE:
                break
            place = record.end
            if record.opcode == FOOTER:
                if data[place:] == MAGIC:
                    return start
                break
        else:
            return start
    return None
