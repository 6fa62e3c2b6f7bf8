"""What a steering fit is made of: commands, angles, and which samples belong together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import pool_blocks

LEVEL = 0.025  # of command: commands closer than half of it are one level
MAX_BLOCK = 50  # samples; a longer run of slowly changing commands is cut into blocks
MIN_FOR_LAG, MAX_LAG = 40, 0.4  # samples, s
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
    command, angle, direction, age, weight = (
        np.concatenate([getattr(p, name) for p in parts])
        for name in ("command", "angle", "direction", "age", "weight"))
    return Samples(command, angle, direction, age, weight,
                   pool_blocks([p.block for p in parts])[1])


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


def answered(t: FloatArray, command: FloatArray, slope: FloatArray, use: BoolArray
             ) -> tuple[FloatArray, float]:
    """(command that the wheels were answering, how much earlier it was given [s]).

    Only where commands change all the time: with held levels the command stays
    as it is, because there the lag touches few samples, and the published
    figures contain them. slope (n,): l W/v.
    """
    _, age = approach(command, t)
    if use.sum() < MIN_FOR_LAG or np.mean(age[use] < SETTLED) < 0.5:
        return command, 0.0
    lags = np.arange(0.0, MAX_LAG + 1e-9, 0.01)
    errors = []
    for lag in lags:
        shifted = np.interp(t[use] - lag, t, command)
        shape = np.vander(shifted, 4)
        fitted = shape @ np.linalg.lstsq(shape, slope[use], rcond=None)[0]
        errors.append(float(np.sum((slope[use] - fitted) ** 2)))
    best = float(lags[int(np.argmin(errors))])
    if best == 0.0:
        return command, 0.0
    return np.interp(t - best, t, command), best


def samples_of_turn(t: FloatArray, command: FloatArray, segment: IntArray, curved: FloatArray,
                    speed: FloatArray, use: BoolArray) -> Samples:
    """The rows ``use`` (n,) of a drive; curved (n,): l W [m/s] beside its speed [m/s]."""
    direction, age = approach(command, t)
    return Samples(command[use], np.arctan2(curved[use], speed[use]), direction[use], age[use],
                   np.ones(int(use.sum())), blocks(command, segment)[use])
