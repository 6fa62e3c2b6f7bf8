"""Whole recordings at once, with the results of the live decoder.

The frames, their order and the counters are those that ``Decoder`` gives on
the same bytes without gates; only the way is another. Blocks that are not
exactly one frame of a fixed length go through the same ``BlockReader``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dart_hal.wire.blocks import OVERHEAD, BlockReader, Counters
from dart_hal.wire.columns import Bytes, dtype, open_blocks
from dart_hal.wire.frame import Frame
from dart_hal.wire.messages import BY_NAME, MESSAGES, Message
from dart_hal.wire.tally import count_losses

_FEW = 64
"""Below this many blocks of a message the fixed cost of the columns is higher
than that of opening them one by one."""


@dataclass(frozen=True, slots=True)
class Columns:
    """All frames of one message, in their order.

    rows (N,) structured raw values (``columns.dtype``); seq (N,) 0..255; end
    (N,) offset in the stream behind the delimiter. Read-only.
    """

    rows: NDArray[np.void]
    seq: NDArray[np.uint8]
    end: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Batch:
    """A decoded stream: ``columns`` by message name (absent: no such frame),
    ``logs`` the LOG frames, ``counters`` as the live decoder counts."""

    columns: dict[str, Columns]
    logs: tuple[Frame, ...]
    counters: Counters

    def frames(self) -> list[Frame]:
        """Every frame in stream order, as ``Decoder.feed`` returns them."""
        found = list(self.logs)
        for name, c in self.columns.items():
            message, data, size = BY_NAME[name], c.rows.tobytes(), BY_NAME[name].size
            found += [Frame(message, seq, data[i * size:(i + 1) * size], end)
                      for i, (seq, end) in enumerate(zip(c.seq.tolist(), c.end.tolist(),
                                                         strict=True))]
        return sorted(found, key=lambda frame: frame.end)


def decode(data: bytes | bytearray | memoryview,
           messages: Iterable[Message] = MESSAGES) -> Batch:
    """Decode a recorded stream of one direction. Never raises on any bytes."""
    stream = np.frombuffer(data, np.uint8)
    stops = np.flatnonzero(stream == 0)
    starts = np.concatenate(([0], stops[:-1] + 1)) if stops.size else stops
    full = stops > starts
    starts, stops = starts[full], stops[full]
    accepted = tuple(messages)
    reader = BlockReader(accepted)
    single, parts = _open_all(stream, starts, stops, accepted, reader.counters)
    singles = _one_by_one(stream, starts[single], stops[single], reader)
    columns = _merge(accepted, parts, singles)
    logs = tuple(frame for frame in singles if frame.message.variable)
    count_losses(reader.counters, [(BY_NAME[name].id, c.seq, c.end, c.rows)
                                   for name, c in columns.items()], logs)
    return Batch(columns, logs, reader.counters)


_Parts = dict[int, Columns]


def _open_all(stream: Bytes, starts: NDArray[np.int64], stops: NDArray[np.int64],
              messages: Iterable[Message], counters: Counters,
              ) -> tuple[NDArray[np.bool_], _Parts]:
    """Open what stands in numbers; the mask tells which blocks are left."""
    left = np.ones(len(starts), np.bool_)
    parts: _Parts = {}
    if not len(starts):
        return left, parts
    sizes, kinds = stops - starts, stream[starts + 1]
    for m in messages:
        if m.variable:
            continue
        mine = np.flatnonzero((sizes == m.size + OVERHEAD) & (kinds == m.id))
        if len(mine) < _FEW:
            continue
        left[mine] = False
        unstuffed, good, seq, payload = open_blocks(stream, starts[mine], m)
        sound, right = int(unstuffed.sum()), int(good.sum())
        counters.cobs += len(mine) - sound
        counters.crc += sound - right
        if right < len(mine):
            mine, seq, payload = mine[good], seq[good], payload[good]
        parts[m.id] = Columns(payload.view(dtype(m.id))[:, 0], seq, stops[mine] + 1)
    return left, parts


def _one_by_one(stream: Bytes, starts: NDArray[np.int64], stops: NDArray[np.int64],
                reader: BlockReader) -> list[Frame]:
    frames: list[Frame] = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        reader.read(stream[start:stop].tobytes(), stop + 1, frames)
    return frames


def _merge(messages: Iterable[Message], parts: _Parts, singles: list[Frame]) -> dict[str, Columns]:
    """Columns of both ways, in stream order."""
    columns: dict[str, Columns] = {}
    for m in messages:
        if m.variable:
            continue
        part = parts.get(m.id)
        few = [frame for frame in singles if frame.message.id == m.id]
        if few:
            part = _joined(part, m, few)
        if part is not None and len(part.seq):
            for array in (part.rows, part.seq, part.end):
                array.setflags(write=False)
            columns[m.name] = part
    return columns


def _joined(part: Columns | None, m: Message, few: list[Frame]) -> Columns:
    rows = np.frombuffer(bytearray().join(frame.payload for frame in few), dtype(m.id))
    seq = np.array([frame.seq for frame in few], np.uint8)
    end = np.array([frame.end for frame in few], np.int64)
    if part is None:
        return Columns(rows, seq, end)
    end = np.concatenate((part.end, end))
    order = np.argsort(end, kind="stable")
    return Columns(np.concatenate((part.rows, rows))[order],
                   np.concatenate((part.seq, seq))[order], end[order])
