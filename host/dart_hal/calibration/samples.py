"""Samples of a steering fit: commands, angles, and blocks with common errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import pool_blocks

# Width of a level of commands: commands closer than half of it are one level.
LEVEL_WIDTH = 0.025
# Samples; a longer run of slowly changing commands is cut into blocks.
MAX_BLOCK = 50
# Samples from which a lag is fitted, and largest lag [s].
MIN_LAG_SAMPLES = 40
MAX_LAG = 0.4
# Samples; 1 s at 10 Hz, longer than the memory of servo and tyres.
MIN_BLOCK = 10
# s after a change of command; before it, delay and lag look like backlash.
MIN_COMMAND_AGE = 0.6


@dataclass(frozen=True, slots=True)
class Samples:
    """n steering samples.

    command (n,) -1..1; angle (n,) rad, atan(l W/v). direction (n,): +1 if the last change of
    command was a rise, -1 a fall, 0 none yet; age (n,) s since then. weight (n,) > 0. block (n,):
    samples of one block (one constant command) share their errors.
    """

    command: FloatArray
    angle: FloatArray
    direction: FloatArray
    age: FloatArray
    weight: FloatArray
    block: IntArray

    def __len__(self) -> int:
        return len(self.command)

    def select(self, rows: BoolArray) -> Samples:
        """Return the samples of ``rows`` (n,)."""
        return Samples(*(getattr(self, f.name)[rows] for f in fields(self)))


def concatenate(parts: Sequence[Samples]) -> Samples:
    """Concatenate samples; blocks stay separate."""
    command, angle, direction, age, weight = (
        np.concatenate([getattr(p, name) for p in parts])
        for name in ("command", "angle", "direction", "age", "weight"))
    return Samples(command, angle, direction, age, weight,
                   pool_blocks([p.block for p in parts])[1])


def approach(command: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(direction, age) of the latest change of command up to each sample.

    direction (n,): +1, -1, 0 = none yet; age (n,) s, from the start if there was none.
    """
    step = np.sign(np.concatenate([[0.0], np.diff(command)]))
    last = np.maximum.accumulate(np.where(step != 0.0, np.arange(len(step)), 0))
    return np.asarray(step[last]), np.asarray(t - t[last])


def blocks(command: FloatArray, segment: IntArray) -> IntArray:
    """Index of the block of each sample: a run of one command, or 5 s of changing commands.

    A run shorter than 1 s joins the previous block.
    """
    change = np.concatenate([[True], (np.diff(command) != 0.0) | (np.diff(segment) != 0)])
    runs = np.flatnonzero(change)
    out = np.zeros(len(command), dtype=np.int64)
    block = 0
    length = 0
    for start, end in zip(runs, [*runs[1:], len(command)], strict=True):
        size = int(end - start)
        new_part = start > 0 and segment[start] != segment[start - 1]
        if start > 0 and (new_part or size >= MIN_BLOCK or length + size > MAX_BLOCK):
            block += 1
            length = 0
        out[start:end] = block
        length += size
    return out


def shift_command(t: FloatArray, command: FloatArray, slope: FloatArray, use: BoolArray
                  ) -> tuple[FloatArray, float]:
    """Shift commands that change all the time by the lag that fits best.

    A cubic of the shifted command is fitted to slope (n,), l W/v, for lags in steps of 0.01 s.
    Constant levels are not shifted, because the lag affects few of their samples, and the published
    figures contain those samples. Returns (command, lag [s]).
    """
    _, age = approach(command, t)
    if use.sum() < MIN_LAG_SAMPLES or np.mean(age[use] < MIN_COMMAND_AGE) < 0.5:
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
    """Make samples of the rows ``use`` (n,) of a drive; curved (n,): l W [m/s]; speed [m/s]."""
    direction, age = approach(command, t)
    return Samples(command[use], np.arctan2(curved[use], speed[use]), direction[use], age[use],
                   np.ones(int(use.sum())), blocks(command, segment)[use])
