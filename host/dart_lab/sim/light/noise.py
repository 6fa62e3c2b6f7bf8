"""Noise with a generator per car and stream, so that the noise of a car is its own.

Standard normal numbers are drawn in blocks and used row by row. The rows of a car depend on its
seed and the stream alone, neither on the number of cars nor on the length of a block.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.vehicle.namespace import Value

# Numbers of the streams; a new one gets the next number and changes no other.
(START_STREAM, FORCE_STREAM, GYRO_STREAM, ACCEL_STREAM, MOCAP_STREAM, ENCODER_STREAM,
 LIDAR_STREAM) = range(7)

# Rows of a block for one car; blocks of many cars have fewer rows, to limit their memory.
BLOCK_ROWS = 256

Seed = int | Sequence[int]


class ScalarStream:
    """``row()``: a list of ``columns`` standard normal floats."""

    def __init__(self, seed: Seed, stream: int, columns: int) -> None:
        self._rng = make_generator(seed, stream)
        self._columns = columns
        self._rows: list[list[float]] = []

    def row(self) -> Sequence[Value]:
        """Return the next row."""
        if not self._rows:
            self._rows = self._rng.standard_normal((BLOCK_ROWS, self._columns))[::-1].tolist()
        return self._rows.pop()


class ArrayStream:
    """``row()``: ``columns`` arrays (n,) of standard normal numbers, one element per seed."""

    def __init__(self, seeds: Sequence[Seed], stream: int, columns: int,
                 dtype: str = "float64") -> None:
        self._rngs = [make_generator(seed, stream) for seed in seeds]
        self._block = np.empty((len(seeds), max(8, min(
            BLOCK_ROWS, 1_600_000 // (len(seeds) * max(columns, 4)))), columns))
        self._rows: NDArray[Any] = np.empty((*self._block.shape[1:], len(seeds)), dtype=dtype)
        self._next = len(self._rows)

    def row(self) -> Sequence[Value]:
        """Return the next row."""
        if self._next == len(self._rows):
            for rng, lane in zip(self._rngs, self._block, strict=True):
                rng.standard_normal(out=lane)
            self._rows[...] = self._block.transpose(1, 2, 0)
            self._next = 0
        self._next += 1
        return tuple(self._rows[self._next - 1])


def make_generator(seed: Seed, stream: int) -> np.random.Generator:
    """Make the generator of one stream of one car."""
    words = [seed] if isinstance(seed, int) else list(seed)
    return np.random.default_rng([*words, stream])


def make_stream(seeds: Sequence[Seed], stream: int, columns: int, scalar: bool,
            dtype: str) -> ScalarStream | ArrayStream:
    """Make the stream of one car (scalar) or of all."""
    return (ScalarStream(seeds[0], stream, columns) if scalar
            else ArrayStream(seeds, stream, columns, dtype))
