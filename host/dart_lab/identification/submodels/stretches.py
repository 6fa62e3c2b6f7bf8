"""Runs of speed samples cut into stretches of some seconds, to be simulated as one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import select_blocks, split_into_blocks
from dart_lab.identification.submodels.speeds import BLOCK_LENGTH, Kernel, Speeds

# [s] Longer stretches add up disturbances, shorter ones only fit their own start.
STRETCH_LENGTH = 3.0
# The free start speed takes most of the information of fewer samples.
MIN_STRETCH_SAMPLES = 4


@dataclass(frozen=True, slots=True)
class Stretches:
    """S stretches with n samples in all.

    series (S,) index into the recordings; start (S,) s on that recording's
    clock; steps: grid steps of the longest; stretch (n,), v (n,) m/s; the
    model's reading of a sample is sum over j of weight (n, j) times the distance at
    step ``node`` (n, j) plus ``part`` (n, j) of the next one.
    """

    series: IntArray
    start: FloatArray
    steps: int
    stretch: IntArray
    v: FloatArray
    node: IntArray
    part: FloatArray
    weight: FloatArray
    block: IntArray
    t: FloatArray

    def __len__(self) -> int:
        return len(self.series)

    def reading(self, distance: FloatArray) -> FloatArray:
        """Return the readings (..., n) for distances (..., S, steps + 1) [m] from each start."""
        row = self.stretch[:, None]
        low, high = distance[..., row, self.node], distance[..., row, self.node + 1]
        return np.asarray(np.sum(self.weight * (low + self.part * (high - low)), axis=-1))


def cut_stretches(series: Sequence[Speeds]) -> Stretches:
    """Cut every run into stretches of at most 3 s, none across runs or recordings."""
    width = max(len(s.kernel.offset) for s in series)
    parts = [_cut_series(i, s, width) for i, s in enumerate(series)]
    pieces = [p for part in parts for p in part]
    count = np.array([len(p.v) for p in pieces])
    stretch = np.repeat(np.arange(len(pieces)), count)
    recording = np.array([p.series for p in pieces])[stretch]
    t = np.concatenate([p.t for p in pieces])
    block = select_blocks(recording, split_into_blocks(t, recording.astype(np.int64), BLOCK_LENGTH))
    node = np.concatenate([p.node for p in pieces])
    return Stretches(
        np.array([p.series for p in pieces]), np.array([p.start for p in pieces]),
        int(node.max()) + 1, stretch, np.concatenate([p.v for p in pieces]), node,
        np.concatenate([p.part for p in pieces]), np.concatenate([p.weight for p in pieces]),
        block.astype(np.int64), t)


@dataclass(frozen=True, slots=True)
class _Piece:
    series: int
    start: float
    t: FloatArray
    v: FloatArray
    node: IntArray
    part: FloatArray
    weight: FloatArray


def _cut_series(index: int, s: Speeds, width: int) -> list[_Piece]:
    out = []
    for run in np.unique(s.run):
        rows = np.flatnonzero(s.run == run)
        number = max(1, int(np.ceil((s.t[rows[-1]] - s.t[rows[0]]) / STRETCH_LENGTH)))
        for piece in np.array_split(rows, number):
            if len(piece) >= MIN_STRETCH_SAMPLES:
                out.append(_make_piece(index, s, piece, s.kernel, width))
    return out


def _make_piece(index: int, s: Speeds, rows: IntArray, kernel: Kernel, width: int) -> _Piece:
    start = float(s.t[rows[0]] + kernel.offset[0])
    place = (s.t[rows][:, None] + kernel.offset - start) / SAMPLE
    node = np.floor(place + 1e-9).astype(np.int64)
    pad = ((0, 0), (0, width - len(kernel.offset)))
    return _Piece(index, start, s.t[rows], s.v[rows], np.pad(node, pad),
                  np.pad(np.clip(place - node, 0.0, 1.0), pad),
                  np.pad(np.broadcast_to(kernel.weight, place.shape), pad))
