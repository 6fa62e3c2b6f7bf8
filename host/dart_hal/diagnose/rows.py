"""Which rows of the stacked residuals belong to what: recording, block, channel, fold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .readings import SENSORS
from .residuals import Evidence, Residuals

BLOCK = 2.0  # s; disturbances of a drive are forgotten after that
FOLDS = 5  # stretches of one recording, where there are few recordings
ENOUGH = 4  # recordings from which on one of them at a time is left out

Labels = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Rows:
    """For each of N stacked residuals: block, recording, fold; and its channel.

    channel (N,): column of the motion residuals, or -1 - column of the sensors.
    """

    block: Labels
    recording: Labels
    fold: Labels
    channel: Labels


def rows_of(evidence: Evidence, r: Residuals) -> Rows:
    """Labels in the order of ``Noise.stacked``."""
    columns, sensors = r.motion.shape[1], r.sensors.shape[1]
    channel = np.concatenate([np.tile(np.arange(columns), len(r.motion)),
                              np.tile(-1 - np.arange(sensors), len(r.sensors))])
    block = spread(*evidence.blocks(BLOCK), columns)
    owner = spread(evidence.motion_drive, evidence.sensor_drive, columns)
    many = len(np.unique(owner)) >= ENOUGH
    still = spread(np.zeros(len(r.motion), dtype=np.int64), evidence.sensor_still.astype(np.int64),
                   columns) > 0
    fold = owner if many else _stretches(owner, block, still)
    return Rows(_numbered(block), _numbered(owner), _numbered(fold), channel)


def spread(windows: Labels, messages: Labels, columns: int) -> Labels:
    """Labels of windows (n,) and messages (m,) for the N stacked residuals."""
    return np.concatenate([np.repeat(windows, columns), np.repeat(messages, len(SENSORS))])


def _stretches(owner: Labels, block: Labels, still: NDArray[np.bool_]) -> Labels:
    """Every recording in FOLDS stretches; a car at rest, where it may be but once, in all."""
    out = np.zeros(len(block), dtype=np.int64)
    for which in np.unique(owner):
        mine = owner == which
        inside = block[mine] - block[mine].min()
        out[mine] = which * FOLDS + np.minimum(inside * FOLDS // (inside.max() + 1), FOLDS - 1)
        rest = mine & still
        out[rest] = which * FOLDS + np.arange(rest.sum()) // len(SENSORS) % FOLDS
    return out


def _numbered(labels: Labels) -> Labels:
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel(), dtype=np.int64)
