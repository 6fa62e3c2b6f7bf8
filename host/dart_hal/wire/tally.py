"""The loss account of ``Ledger``, over a whole recording at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dart_hal.wire.blocks import Counters
from dart_hal.wire.frame import Frame
from dart_hal.wire.ledger import LIMIT, LONG, MASK32, boot_of, rounds
from dart_hal.wire.messages import HELLO, STATE

Part = tuple[int, NDArray[np.uint8], NDArray[np.int64], NDArray[np.void]]
"""(message id, seq, end, rows) of one message."""


def count_losses(counters: Counters, parts: Sequence[Part], logs: Sequence[Frame]) -> None:
    """Set ok, gaps and rebased as a ``Ledger`` fed in stream order would."""
    end = np.concatenate([part[2] for part in parts] + [np.array([f.end for f in logs], np.int64)])
    seq = np.concatenate([part[1] for part in parts] + [np.array([f.seq for f in logs], np.uint8)])
    counters.ok = len(end)
    if not len(end):
        return
    order = np.argsort(end, kind="stable")
    step = np.ones(len(end), np.int64)
    # uint8 arithmetic is arithmetic modulo 256.
    step[1:] += seq[order][1:] - seq[order][:-1] - np.uint8(1)
    end = end[order]
    boots = _boots(parts, end)
    step[boots] = 1
    counters.rebased = len(boots)
    for ident, _, ends, rows in parts:
        if ident == STATE.id:
            counters.rebased += _silences(step, boots, np.searchsorted(end, ends), rows["t_ck"])
    counters.gaps = int(step.sum()) - len(step)


def _boots(parts: Sequence[Part], end: NDArray[np.int64]) -> NDArray[np.int64]:
    """Places in the stream order of HELLO frames of another boot than the last one."""
    for ident, _, ends, rows in parts:
        if ident == HELLO.id:
            boots = [boot_of(row.tobytes()) for row in rows]
            new = [i for i in range(1, len(boots)) if boots[i] != boots[i - 1]]
            return np.searchsorted(end, ends[new])
    return np.empty(0, np.int64)


def _silences(step: NDArray[np.int64], boots: NDArray[np.int64], at: NDArray[np.int64],
              t_ck: NDArray[np.uint32]) -> int:
    """Correct ``step`` at STATE frames after long silences; returns the rebased ones."""
    ticks = t_ck.astype(np.int64)
    elapsed = (ticks[1:] - ticks[:-1]) & MASK32
    rebased = 0
    for i in np.flatnonzero(elapsed > LONG).tolist():
        before, now = int(at[i]), int(at[i + 1])
        if np.any((boots > before) & (boots < now)):
            continue
        if elapsed[i] > LIMIT:
            step[now] = 1
            rebased += 1
        else:
            step[now] += rounds(int(elapsed[i]), int(step[before + 1:now + 1].sum()))
    return rebased
