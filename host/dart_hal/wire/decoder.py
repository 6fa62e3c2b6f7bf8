"""Decode a byte stream to frames, without I/O.

The decoder raises no error for any input, returns a frame only after its delimiter, gives the same
frames and counters for any division of the stream into reads, and stores at most one block.
"""

from __future__ import annotations

from collections.abc import Iterable

from dart_hal.wire.blocks import BlockReader, Counters
from dart_hal.wire.frame import WireFrame
from dart_hal.wire.ledger import SequenceTracker
from dart_hal.wire.messages import HELLO, MAX_BLOCK, MESSAGES, STATE, Message
from dart_hal.wire.plausible import Gates

__all__ = ["Counters", "FrameDecoder"]


class FrameDecoder:
    """Decodes one direction of one link.

    messages: the accepted ones (``codec.UP`` on a host, ``codec.DOWN`` on a Nano); gates: if
    given, they reject impossible STATE frames.
    """

    def __init__(self, messages: Iterable[Message] = MESSAGES, gates: Gates | None = None) -> None:
        self._reader = BlockReader(messages)
        self._gates = gates
        self._tracker = SequenceTracker()
        self._tail = b""
        self._cut = 0
        self._end = 0

    @property
    def counters(self) -> Counters:
        """Counters up to the last delimiter (one object that ``feed`` updates)."""
        return self._reader.counters

    def feed(self, data: bytes | bytearray | memoryview) -> list[WireFrame]:
        """Return the frames whose delimiter is in ``data``, in their order. Raises no error."""
        # The bytes after the last delimiter are stored until the next call.
        head, delimiter, rest = bytes(data).rpartition(b"\0")
        if not delimiter:
            self._store_tail(self._tail + rest)
            return []
        stream = self._tail + head
        end = self._end + self._cut
        self._cut = 0
        self._store_tail(rest)
        frames: list[WireFrame] = []
        read = self._reader.read
        for block in stream.split(b"\0"):
            end += len(block) + 1
            if block:
                read(block, end, frames)
        self._end = end
        return self._count(frames)

    def _store_tail(self, tail: bytes) -> None:
        """Store the bytes after the last delimiter; of too many only enough to detect them."""
        if len(tail) > MAX_BLOCK:
            self._cut += len(tail) - MAX_BLOCK - 1
            tail = tail[:MAX_BLOCK + 1]
        self._tail = tail

    def _count(self, frames: list[WireFrame]) -> list[WireFrame]:
        """Reject impossible frames and update the counters."""
        if self._gates is not None:
            frames = self._reject_implausible(frames, self._gates)
        tracker = self._tracker
        for message, seq, payload, _ in frames:
            tracker.add_frame(message.id, seq, payload)
        counters = self._reader.counters
        counters.ok += len(frames)
        counters.gaps = tracker.lost
        counters.rebased = tracker.rebased
        return frames

    def _reject_implausible(self, frames: list[WireFrame], gates: Gates) -> list[WireFrame]:
        """Return the frames that pass the gates."""
        accepted = []
        for frame in frames:
            if frame.message.id == HELLO.id:
                gates.rebase()
            if frame.message.id != STATE.id or gates.passes(frame.values()):
                accepted.append(frame)
        self._reader.counters.implausible += len(frames) - len(accepted)
        return accepted
