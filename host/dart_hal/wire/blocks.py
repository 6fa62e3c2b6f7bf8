"""One block between two delimiters: a frame, two that were joined, or junk."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterable
from dataclasses import dataclass

from dart_hal.wire.frame import Frame
from dart_hal.wire.messages import MAX_BLOCK, Message
from dart_hal.wire.rules import min_size

OVERHEAD = 5
"""Bytes of a block beyond the payload: COBS code, type, seq, CRC."""


@dataclass
class Counters:
    """What happened since the decoder was made.

    ok: frames returned; crc, cobs, length, unknown (type), oversize: damaged
    blocks by what was found first; implausible: refused by the gates;
    repaired: frames out of blocks whose delimiter was damaged (also in ok);
    gaps: frames lost between the first and the last good one, by their
    sequence number; rebased: times that count began anew.
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
        """Blocks that gave no frame."""
        return self.crc + self.cobs + self.length + self.unknown + self.oversize


def block_sizes(message: Message) -> range:
    """Lengths [B] that a block of this message can have."""
    return range(min_size(message) + OVERHEAD, message.size + OVERHEAD + 1)


class BlockReader:
    """Opens blocks of the given messages and counts those that fail."""

    def __init__(self, messages: Iterable[Message]) -> None:
        self.counters = Counters()
        self._by_id = {m.id: m for m in messages}
        self._table = {size << 8 | m.id: (m, m.seed)
                       for m in self._by_id.values() for size in block_sizes(m)}

    def read(self, block: bytes, end: int, frames: list[Frame]) -> None:
        """Append the frames of a non-empty block; ``end``: offset behind its delimiter."""
        # The type is never zero, so it stands unchanged behind the first code
        # byte and tells the length before anything is decoded.
        size = len(block)
        spec = self._table.get(size << 8 | block[1]) if size > 1 else None
        if spec is None:
            self._odd(block, end, frames)
            return
        message, seed = spec
        raw = bytearray(block)
        if not _unstuff(raw):
            self.counters.cobs += 1
        elif crc_hqx(raw[1:-2], seed) != raw[-2] | raw[-1] << 8:
            self.counters.crc += 1
        else:
            frames.append(Frame(message, raw[2], bytes(raw[3:-2]), end))

    def _odd(self, block: bytes, end: int, frames: list[Frame]) -> None:
        at = self._joint(block)
        if at:
            pair: list[Frame] = []
            self._attempt(block[:at], end - len(block) + at, pair)
            self._attempt(block[at + 1:], end, pair)
            if len(pair) == 2:
                self.counters.repaired += 2
                frames += pair
                return
        self._refuse(block)

    def _joint(self, block: bytes) -> int:
        """Where the delimiter of two joined frames must have been; 0 = they are not that.

        The block must have exactly the length of both frames and one byte
        more. The length of a LOG is not known beforehand, so it can only be
        the second.
        """
        first = self._by_id.get(block[1]) if 1 < len(block) <= MAX_BLOCK else None
        if first is None or first.variable:
            return 0
        at = first.size + OVERHEAD
        rest = len(block) - at - 1
        return at if rest > 1 and rest << 8 | block[at + 2] in self._table else 0

    def _attempt(self, block: bytes, end: int, frames: list[Frame]) -> None:
        counters = self.counters
        before = counters.cobs, counters.crc
        self.read(block, end, frames)
        counters.cobs, counters.crc = before

    def _refuse(self, block: bytes) -> None:
        if len(block) > MAX_BLOCK:
            self.counters.oversize += 1
        elif len(block) <= OVERHEAD or block[1] in self._by_id:
            self.counters.length += 1
        else:
            self.counters.unknown += 1


def _unstuff(raw: bytearray) -> bool:
    """Undo COBS in place behind the code byte; False when the chain is broken.

    Below 254 bytes every code byte but the first stands for one zero. A first
    code of 1 would mean a type of zero.
    """
    size = len(raw)
    at = raw[0]
    if at == 1:
        return False
    while at < size:
        step = raw[at]
        raw[at] = 0
        at += step
    return at == size
