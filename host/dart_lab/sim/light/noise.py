"""Noise with a generator per car and stream, so that no car hears another.

Standard normal numbers are drawn in blocks and used row by row. A car's rows
depend on its seed and the stream alone: neither on how many cars there are nor
on the length of a block.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.vehicle.namespace import Value

START, FORCE, GYRO, ACCEL, MOCAP, ENCODER, LIDAR = range(7)
"""Numbers of the streams; a new one gets the next number and changes no other."""

ROWS = 256
"""Rows of a block for one car; fewer for many, which must fit into memory."""

Seed = int | Sequence[int]


class ScalarStream:
    """``row()``: a list of ``columns`` standard normal floats."""

    def __init__(self, seed: Seed, stream: int, columns: int) -> None:
        self._rng = generator(seed, stream)
        self._columns = columns
        self._rows: list[list[float]] = []

    def row(self) -> Sequence[Value]:
        """The next row."""
        if not self._rows:
            self._rows = self._rng.standard_normal((ROWS, self._columns))[::-1].tolist()
        return self._rows.pop()


class ArrayStream:
    """``row()``: ``columns`` arrays (n,) of standard normal numbers, a lane per seed."""

    def __init__(self, seeds: Sequence[Seed], stream: int, columns: int,
                 dtype: str = "float64") -> None:
        self._rngs = [generator(seed, stream) for seed in seeds]
        self._block = np.empty((len(seeds), max(8, min(
            ROWS, 1_600_000 // (len(seeds) * max(columns, 4)))), columns))
        self._rows: NDArray[Any] = np.empty((*self._block.shape[1:], len(seeds)), dtype=dtype)
        self._next = len(self._rows)

    def row(self) -> Sequence[Value]:
        """The next row."""
        if self._next == len(self._rows):
            for rng, lane in zip(self._rngs, self._block, strict=True):
                rng.standard_normal(out=lane)
            self._rows[...] = self._block.transpose(1, 2, 0)
            self._next = 0
        self._next += 1
        return tuple(self._rows[self._next - 1])


def generator(seed: Seed, stream: int) -> np.random.Generator:
    """The generator of one stream of one car."""
    words = [seed] if isinstance(seed, int) else list(seed)
    return np.random.default_rng([*words, stream])


def streams(seeds: Sequence[Seed], stream: int, columns: int, scalar: bool,
            dtype: str) -> ScalarStream | ArrayStream:
    """The stream of one car (scalar) or of all."""
    return (ScalarStream(seeds[0], stream, columns) if scalar
            else ArrayStream(seeds, stream, columns, dtype))
