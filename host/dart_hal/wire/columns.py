"""Many frames of one message at once: COBS and CRC column by column.

Blocks of equal length form a matrix; each numpy call then handles one byte
position of some thousand frames.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dart_hal.wire.blocks import OVERHEAD
from dart_hal.wire.crc import columns as crc_columns
from dart_hal.wire.messages import BY_ID, Field, Message

Bytes = NDArray[np.uint8]

_ROWS = 4096
"""Frames per pass: a matrix of 4096 x 43 B stays in the second-level cache."""

_NUMPY = {"u8": "u1", "u16": "<u2", "u32": "<u4", "i16": "<i2"}


@cache
def dtype(ident: int) -> np.dtype[np.void]:
    """Packed structured dtype of a message's payload (not of LOG)."""
    def entry(f: Field) -> tuple[str, str] | tuple[str, str, tuple[int, ...]]:
        kind = _NUMPY[f.type]
        return (f.name, kind) if f.count == 1 else (f.name, kind, (f.count,))
    return np.dtype([entry(f) for f in BY_ID[ident].fields])


def open_blocks(stream: Bytes, starts: NDArray[np.int64], message: Message,
                ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Bytes, Bytes]:
    """Open the blocks of ``message`` that begin at ``starts`` (N,).

    Returns (unstuffed, good, seq, payload): masks (N,) of sound COBS and of a
    right CRC behind it, seq (N,) and payload (N, size), whose rows mean
    nothing where ``good`` is false.
    """
    count = len(starts)
    unstuffed, good = np.empty(count, np.bool_), np.empty(count, np.bool_)
    seq, payload = np.empty(count, np.uint8), np.empty((count, message.size), np.uint8)
    windows = sliding_window_view(stream, message.size + OVERHEAD)
    for first in range(0, count, _ROWS):
        part = slice(first, first + _ROWS)
        block = np.ascontiguousarray(windows[starts[part]].T)
        unstuffed[part] = _unstuff(block)
        crc = crc_columns(block[1:-2], message.seed)
        sent = block[-1].astype(np.uint16) << 8 | block[-2]
        good[part] = unstuffed[part] & (crc == sent)
        seq[part] = block[2]
        payload[part] = block[3:-2].T
    return unstuffed, good, seq, payload


def _unstuff(block: Bytes) -> NDArray[np.bool_]:
    """Undo COBS in place in columns (length, N); mask (N,) of unbroken chains.

    ``due`` is the position of each frame's next code byte. A step beyond 255
    wraps to a position that is already past, and so fails the last test.
    """
    length, count = block.shape
    due = block[0].copy()
    hit = np.empty(count, np.bool_)
    keep, step = np.empty(count, np.uint8), np.empty(count, np.uint8)
    for at in range(1, length):
        column = block[at]
        np.equal(due, at, out=hit)
        np.subtract(hit.view(np.uint8), 1, out=keep)
        np.bitwise_and(column, keep, out=keep)
        np.bitwise_xor(column, keep, out=step)
        np.add(due, step, out=due)
        column[:] = keep
    sound: NDArray[np.bool_] = (due == length) & (block[0] != 1)
    return sound
