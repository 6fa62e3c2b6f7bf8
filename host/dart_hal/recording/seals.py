"""Checksums inside a run, so that damage costs only the block that it hit.

MCAP without chunks carries no checksum of its messages, and a record's length
is all that leads to the next one. So a run writes, at each flush, a *seal*: a
record of an opcode that MCAP leaves to applications (readers skip it), with
the length and CRC-32 of the bytes since the seal before, and a running number.
"""

from __future__ import annotations

from struct import Struct
from typing import BinaryIO, NamedTuple
from zlib import crc32

OPCODE = 0x80
SEAL_TEXT = ("opcode 0x80: u32 length and u32 CRC-32 of the bytes since the seal before, "
             "u32 running number; little-endian")
"""Stands in each run, for readers of other make."""
_SEAL = Struct("<BQIII")  # opcode, 12, length, CRC-32, number
_MARK = Struct("<BQ").pack(OPCODE, 12)
SIZE = _SEAL.size


class SealedFile:
    """The output of an MCAP writer that can put a seal behind what was written."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._length = self._crc = self._number = 0

    def write(self, data: bytes) -> int:
        """Append."""
        self._length += len(data)
        self._crc = crc32(data, self._crc)
        return self._file.write(data)

    def tell(self) -> int:
        """Bytes written."""
        return self._file.tell()

    def seal(self) -> None:
        """Close the block and hand everything to the operating system."""
        if self._length:
            self._file.write(_SEAL.pack(OPCODE, 12, self._length, self._crc, self._number))
            self._length, self._crc, self._number = 0, 0, self._number + 1
        self.flush()

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Block(NamedTuple):
    """Bytes ``start`` to ``end`` (its seal included) are what was written; ``number`` from 0."""

    start: int
    end: int
    number: int


def sealed_blocks(data: bytes) -> list[Block]:
    """Every block whose seal holds, in file order; empty for a file without seals."""
    blocks: list[Block] = []
    last = 0
    at = data.find(_MARK)
    while 0 <= at <= len(data) - SIZE:
        _, _, length, crc, number = _SEAL.unpack_from(data, at)
        start = at - length
        if length and start >= last and crc32(memoryview(data)[start:at]) == crc:
            last = at + SIZE
            blocks.append(Block(start, last, number))
        at = data.find(_MARK, max(at + 1, last))
    return blocks
