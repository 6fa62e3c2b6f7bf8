"""Decode the block between two delimiters: a frame, two joined frames, or invalid bytes."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterable
from dataclasses import dataclass

from dart_hal.wire.frame import WireFrame
from dart_hal.wire.messages import MAX_BLOCK, Message
from dart_hal.wire.rules import min_size

# Bytes of a block beyond the payload: COBS code, type, seq, CRC.
OVERHEAD = 5


@dataclass
class Counters:
    """Counters of a decoder since its construction.

    ok: returned frames; crc, cobs, length, unknown (type), oversize: damaged blocks by the first
    error; implausible: frames rejected by the gates; repaired: frames from blocks with a damaged
    delimiter (also in ok); gaps: frames lost between the first and the last valid one, by their
    sequence numbers; rebased: restarts of that count.
    """

    ok: int = 0
    crc: int = 0
    cobs: int = 0
    length: int = 0
    unknown: int = 0
    oversize: int = 0
    implausible: int = 0
    repaired: int = 0
    gaps: int = 0
    rebased: int = 0

    @property
    def damaged(self) -> int:
        """Number of blocks without a frame."""
        return self.crc + self.cobs + self.length + self.unknown + self.oversize


def block_sizes(message: Message) -> range:
    """Return the possible lengths [B] of a block of this message."""
    return range(min_size(message) + OVERHEAD, message.size + OVERHEAD + 1)


class BlockReader:
    """Decodes blocks of the given messages and counts the damaged ones."""

    def __init__(self, messages: Iterable[Message]) -> None:
        self.counters = Counters()
        self._by_id = {m.id: m for m in messages}
        self._table = {size << 8 | m.id: (m, m.seed)
                       for m in self._by_id.values() for size in block_sizes(m)}

    def read(self, block: bytes, end: int, frames: list[WireFrame]) -> None:
        """Append the frames of a non-empty block; end: offset after its delimiter."""
        # The type is never zero, so COBS leaves it unchanged after the first code byte. It
        # determines the possible lengths before anything is decoded.
        size = len(block)
        spec = self._table.get(size << 8 | block[1]) if size > 1 else None
        if spec is None:
            self._read_joined(block, end, frames)
            return
        message, seed = spec
        raw = bytearray(block)
        if not _unstuff(raw):
            self.counters.cobs += 1
        elif crc_hqx(raw[1:-2], seed) != raw[-2] | raw[-1] << 8:
            self.counters.crc += 1
        else:
            frames.append(WireFrame(message, raw[2], bytes(raw[3:-2]), end))

    def _read_joined(self, block: bytes, end: int, frames: list[WireFrame]) -> None:
        """Append the two frames of a block with a damaged delimiter, else count the block."""
        joint = self._find_joint(block)
        if joint:
            pair: list[WireFrame] = []
            self._try_read(block[:joint], end - len(block) + joint, pair)
            self._try_read(block[joint + 1:], end, pair)
            if len(pair) == 2:
                self.counters.repaired += 2
                frames += pair
                return
        self._count_damaged(block)

    def _find_joint(self, block: bytes) -> int:
        """Return the offset of the damaged delimiter between two joined frames; 0 = none.

        The block must have exactly the length of both frames plus one byte. The length of a LOG is
        not known in advance, so only the second frame can be one.
        """
        first = self._by_id.get(block[1]) if 1 < len(block) <= MAX_BLOCK else None
        if first is None or first.variable:
            return 0
        joint = first.size + OVERHEAD
        rest = len(block) - joint - 1
        return joint if rest > 1 and rest << 8 | block[joint + 2] in self._table else 0

    def _try_read(self, block: bytes, end: int, frames: list[WireFrame]) -> None:
        """Read a block without counting its errors."""
        counters = self.counters
        before = counters.cobs, counters.crc
        self.read(block, end, frames)
        counters.cobs, counters.crc = before

    def _count_damaged(self, block: bytes) -> None:
        """Count a block without a frame by its first error."""
        if len(block) > MAX_BLOCK:
            self.counters.oversize += 1
        elif len(block) <= OVERHEAD or block[1] in self._by_id:
            self.counters.length += 1
        else:
            self.counters.unknown += 1


def _unstuff(raw: bytearray) -> bool:
    """Decode COBS in place after the code byte; return whether the chain of codes is valid.

    Below 254 bytes, every code byte except the first replaces one zero. A first code of 1 would
    mean a type of zero.
    """
    size = len(raw)
    position = raw[0]
    if position == 1:
        return False
    # Each code byte is the distance to the next one; the chain must end at the end of the block.
    while position < size:
        step = raw[position]
        raw[position] = 0
        position += step
    return position == size
