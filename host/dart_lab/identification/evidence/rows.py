"""Labels of the stacked residuals: recording, block of time, channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import IntArray

from .policy import BLOCK_S, MANY_RECORDINGS
from .readings import SENSORS
from .residuals import Evidence, Residuals


@dataclass(frozen=True, slots=True)
class RowLabels:
    """Block, recording and channel of each of the N stacked residuals.

    channel (N,): column of the motion residuals, or -1 - column of the sensors.
    """

    block: IntArray
    recording: IntArray
    channel: IntArray

    @property
    def unit(self) -> IntArray:
        """Independent units (N,): recordings, or blocks if there are few recordings."""
        many = int(self.recording.max()) + 1 >= MANY_RECORDINGS
        return self.recording if many else self.block


def label_rows(evidence: Evidence, r: Residuals, block_s: float = BLOCK_S) -> RowLabels:
    """Label the residuals in the order of ``Noise.stack``; block_s [s]: length of a block."""
    columns = r.motion.shape[1]
    sensors = r.sensors.shape[1]
    channel = np.concatenate([np.tile(np.arange(columns), len(r.motion)),
                              np.tile(-1 - np.arange(sensors), len(r.sensors))])
    block = repeat_labels(*evidence.blocks(block_s), columns)
    owner = repeat_labels(evidence.motion_drive, evidence.sensor_drive, columns)
    return RowLabels(_renumber(block), _renumber(owner), channel)


def repeat_labels(windows: IntArray, messages: IntArray, columns: int) -> IntArray:
    """Repeat labels of windows (n,) and messages (m,) for the N stacked residuals.

    The stack holds ``columns`` motion residuals of each window, then all sensors of each message.
    """
    return np.concatenate([np.repeat(windows, columns), np.repeat(messages, len(SENSORS))])


def _renumber(labels: IntArray) -> IntArray:
    """Replace labels by 0, 1, 2, ... in ascending order."""
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel(), dtype=np.int64)
