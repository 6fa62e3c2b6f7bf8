"""Which rows of the stacked residuals belong to what: recording, block, channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import IntArray

from ..policy import BlockPolicy
from .readings import SENSORS
from .residuals import Evidence, Residuals


@dataclass(frozen=True, slots=True)
class RowLabels:
    """For each of N stacked residuals: block, recording, and its channel.

    channel (N,): column of the motion residuals, or -1 - column of the sensors.
    """

    block: IntArray
    recording: IntArray
    channel: IntArray


def rows_of(evidence: Evidence, r: Residuals, policy: BlockPolicy) -> RowLabels:
    """Labels in the order of ``Noise.stacked``."""
    columns, sensors = r.motion.shape[1], r.sensors.shape[1]
    channel = np.concatenate([np.tile(np.arange(columns), len(r.motion)),
                              np.tile(-1 - np.arange(sensors), len(r.sensors))])
    block = spread(*evidence.blocks(policy.seconds), columns)
    owner = spread(evidence.motion_drive, evidence.sensor_drive, columns)
    return RowLabels(_numbered(block), _numbered(owner), channel)


def spread(windows: IntArray, messages: IntArray, columns: int) -> IntArray:
    """Labels of windows (n,) and messages (m,) for the N stacked residuals."""
    return np.concatenate([np.repeat(windows, columns), np.repeat(messages, len(SENSORS))])


def _numbered(labels: IntArray) -> IntArray:
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel(), dtype=np.int64)
