"""Runs of version 0.1, which had no chunks but blocks with their own checksums.

At each flush they have a *seal*: a record of an opcode that MCAP reserves for applications, with
the length and CRC-32 of the bytes since the last seal, and a running number.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple
from zlib import crc32

_SEAL = Struct("<BQIII")  # opcode 0x80, 12, length, CRC-32, number
_MARK = Struct("<BQ").pack(0x80, 12)


class Block(NamedTuple):
    """A block of bytes ``start`` to ``end``, its seal included; ``number`` from 0."""

    start: int
    end: int
    number: int


def find_sealed_blocks(data: bytes) -> list[Block]:
    """Return the blocks with a correct seal, in file order; empty for a file without seals."""
    blocks: list[Block] = []
    last = 0
    at = data.find(_MARK)
    while 0 <= at <= len(data) - _SEAL.size:
        _, _, length, crc, number = _SEAL.unpack_from(data, at)
        # A block counts if the seal at its end has its length and checksum; any other place of
        # these bytes is data, and the search goes on one byte later.
        start = at - length
        if length and start >= last and crc32(memoryview(data)[start:at]) == crc:
            last = at + _SEAL.size
            blocks.append(Block(start, last, number))
        at = data.find(_MARK, max(at + 1, last))
    return blocks
