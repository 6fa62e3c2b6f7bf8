"""Which rows of the stacked residuals belong to what: recording, block, channel, fold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.types import BoolArray, IntArray

from ..policy import BlockPolicy
from .readings import SENSORS
from .residuals import Evidence, Residuals


@dataclass(frozen=True, slots=True)
class RowLabels:
    """For each of N stacked residuals: block, recording, fold; and its channel.

    channel (N,): column of the motion residuals, or -1 - column of the sensors.
    """

    block: IntArray
    recording: IntArray
    fold: IntArray
    channel: IntArray


def rows_of(evidence: Evidence, r: Residuals, policy: BlockPolicy) -> RowLabels:
    """Labels in the order of ``Noise.stacked``."""
    columns, sensors = r.motion.shape[1], r.sensors.shape[1]
    channel = np.concatenate([np.tile(np.arange(columns), len(r.motion)),
                              np.tile(-1 - np.arange(sensors), len(r.sensors))])
    block = spread(*evidence.blocks(policy.seconds), columns)
    owner = spread(evidence.motion_drive, evidence.sensor_drive, columns)
    many = len(np.unique(owner)) >= policy.recordings
    still = spread(np.zeros(len(r.motion), dtype=np.int64), evidence.sensor_still.astype(np.int64),
                   columns) > 0
    fold = owner if many else _stretches(owner, block, still, policy.folds)
    return RowLabels(_numbered(block), _numbered(owner), _numbered(fold), channel)


def spread(windows: IntArray, messages: IntArray, columns: int) -> IntArray:
    """Labels of windows (n,) and messages (m,) for the N stacked residuals."""
    return np.concatenate([np.repeat(windows, columns), np.repeat(messages, len(SENSORS))])


def _stretches(owner: IntArray, block: IntArray, still: BoolArray, folds: int) -> IntArray:
    """Every recording in so many stretches; a car at rest, where it may be but once, in all."""
    out = np.zeros(len(block), dtype=np.int64)
    for which in np.unique(owner):
        mine, rest = ((owner == which) & part for part in (~still, still))
        if mine.any():
            inside = block[mine] - block[mine].min()
            out[mine] = which * folds + np.minimum(inside * folds // (inside.max() + 1), folds - 1)
        out[rest] = which * folds + np.arange(rest.sum()) // len(SENSORS) % folds
    return out


def _numbered(labels: IntArray) -> IntArray:
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel(), dtype=np.int64)
