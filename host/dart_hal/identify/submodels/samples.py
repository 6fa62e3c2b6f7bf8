"""What a steering fit is made of: commands, angles, and which samples belong together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dart_hal.types import FloatArray

IntArray = NDArray[np.int64]
MAX_BLOCK = 50  # samples; a longer run of slowly changing commands is cut into blocks
MIN_BLOCK = 10  # samples; 1 s at 10 Hz, longer than the memory of servo and tyres
SETTLED = 0.6  # s after a change of command; before it delay and lag look like backlash


@dataclass(frozen=True, slots=True)
class Samples:
    """n steering samples.

    command (n,) -1..1; angle (n,) rad, atan(l W/v); direction (n,): +1 the last
    change of command was a rise, -1 a fall, 0 none yet; age (n,) s since that
    change; weight (n,) > 0; block (n,): samples of one block share their errors
    (one held command).
    """

    command: FloatArray
    angle: FloatArray
    direction: FloatArray
    age: FloatArray
    weight: FloatArray
    block: IntArray

    def __len__(self) -> int:
        return len(self.command)


def concatenate(parts: Sequence[Samples]) -> Samples:
    """All samples; blocks stay apart."""
    start, blocks = 0, []
    for part in parts:
        _, index = np.unique(part.block, return_inverse=True)
        blocks.append(index + start)
        start += int(index.max()) + 1 if len(index) else 0
    return Samples(np.concatenate([p.command for p in parts]),
                   np.concatenate([p.angle for p in parts]),
                   np.concatenate([p.direction for p in parts]),
                   np.concatenate([p.age for p in parts]),
                   np.concatenate([p.weight for p in parts]),
                   np.concatenate(blocks).astype(np.int64))


def approach(command: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(direction, age) of the last change of command before or at each sample.

    direction (n,) +1, -1, 0 = none yet; age (n,) s, from the start if none.
    """
    step = np.sign(np.concatenate([[0.0], np.diff(command)]))
    last = np.maximum.accumulate(np.where(step != 0.0, np.arange(len(step)), 0))
    return np.asarray(step[last]), np.asarray(t - t[last])


def blocks(command: FloatArray, segment: IntArray) -> IntArray:
    """Runs of one command; where commands change all the time, stretches of 5 s.

    A run shorter than 1 s joins the block before it.
    """
    change = np.concatenate([[True], (np.diff(command) != 0.0) | (np.diff(segment) != 0)])
    runs = np.flatnonzero(change)
    out = np.zeros(len(command), dtype=np.int64)
    block, length = 0, 0
    for start, end in zip(runs, [*runs[1:], len(command)], strict=True):
        size = int(end - start)
        new_part = start > 0 and segment[start] != segment[start - 1]
        if start > 0 and (new_part or size >= MIN_BLOCK or length + size > MAX_BLOCK):
            block, length = block + 1, 0
        out[start:end] = block
        length += size
    return out
