"""The stream decoder: bytes in, frames out, no I/O.

Contract: it never raises on any input, never returns a frame before its
delimiter, gives the same frames and counters however the stream is cut into
reads, and keeps at most one block of memory.
"""

from __future__ import annotations

from collections.abc import Iterable

from dart_hal.wire.blocks import BlockReader, Counters
from dart_hal.wire.frame import Frame
from dart_hal.wire.ledger import Ledger
from dart_hal.wire.messages import HELLO, MAX_BLOCK, MESSAGES, STATE, Message
from dart_hal.wire.plausible import Gates

__all__ = ["Counters", "Decoder"]


class Decoder:
    """Decodes one direction of one link.

    ``messages``: those to accept (``codec.UP`` on a host, ``codec.DOWN`` on a
    Nano, all by default). ``gates``: also refuse STATE frames that are not
    possible.
    """

    def __init__(self, messages: Iterable[Message] = MESSAGES, gates: Gates | None = None) -> None:
        self._reader = BlockReader(messages)
        self._gates = gates
        self._ledger = Ledger()
        self._tail = b""
        self._cut = 0
        self._end = 0

    @property
    def counters(self) -> Counters:
        """Counters up to the last delimiter (one object, kept up to date by ``feed``)."""
        return self._reader.counters

    def feed(self, data: bytes | bytearray | memoryview) -> list[Frame]:
        """Frames whose delimiter is in ``data``, in their order. Never raises."""
        head, delimiter, rest = bytes(data).rpartition(b"\0")
        if not delimiter:
            self._keep(self._tail + rest)
            return []
        stream = self._tail + head
        end = self._end + self._cut
        self._cut = 0
        self._keep(rest)
        frames: list[Frame] = []
        read = self._reader.read
        for block in stream.split(b"\0"):
            end += len(block) + 1
            if block:
                read(block, end, frames)
        self._end = end
        return self._enter(frames)

    def _keep(self, tail: bytes) -> None:
        """Hold what follows the last delimiter; of a flood only that it was one."""
        if len(tail) > MAX_BLOCK:
            self._cut += len(tail) - MAX_BLOCK - 1
            tail = tail[:MAX_BLOCK + 1]
        self._tail = tail

    def _enter(self, frames: list[Frame]) -> list[Frame]:
        if self._gates is not None:
            frames = self._possible(frames, self._gates)
        ledger = self._ledger
        for message, seq, payload, _ in frames:
            ledger.note(message.id, seq, payload)
        counters = self._reader.counters
        counters.ok += len(frames)
        counters.gaps = ledger.lost
        counters.rebased = ledger.rebased
        return frames

    def _possible(self, frames: list[Frame], gates: Gates) -> list[Frame]:
        kept = []
        for frame in frames:
            if frame.message.id == HELLO.id:
                gates.rebase()
            if frame.message.id != STATE.id or gates.passes(frame.values()):
                kept.append(frame)
        self._reader.counters.implausible += len(frames) - len(kept)
        return kept
