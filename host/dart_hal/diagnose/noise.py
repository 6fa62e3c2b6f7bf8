"""How large and how alike the residuals are, so that each counts for what it tells.

Read-outs of one window share their disturbance: they are whitened by their
own covariance. Windows and messages in a row share it too: a channel counts
less by as much as its sums over blocks vary more than independent values would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dart_hal.types import FloatArray

from .residuals import Residuals

ROBUST = 3.0  # standard deviations from where on a residual counts by its size
WILD = 30.0  # no residual counts as more
CLIPPED = 4.0  # for the estimates of this module
FINEST = np.array([0.002, 0.0, 0.0, 0.0])
"""Of SENSORS: no reading is told better. Half a millisecond at 4 m/s2 is 2 mm/s of an encoder."""
RIDGE = 0.02  # of a variance; keeps the covariance of few windows invertible


@dataclass(frozen=True, slots=True)
class Noise:
    """motion (c, c) whitens a row of motion residuals; sensors (4,): sizes; worth (c + 4,)."""

    motion: FloatArray
    sensors: FloatArray
    worth: FloatArray

    def whiten(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations, (n, c) and (m, 4), wild ones held down."""
        motion = np.nan_to_num(r.motion, nan=1e3, posinf=1e3, neginf=-1e3) @ self.motion.T
        sensors = np.nan_to_num(r.sensors / self.sensors, nan=0.0)
        return np.clip(motion, -WILD, WILD), np.clip(sensors, -WILD, WILD)

    def with_motion(self, other: Noise) -> Noise:
        """The same with the motion of another."""
        c = len(self.motion)
        return Noise(other.motion, self.sensors, np.concatenate([other.worth[:c], self.worth[c:]]))

    def stacked(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """(residuals in standard deviations, what each is worth), (N,) both."""
        motion, sensors = self.whiten(r)
        c = motion.shape[1]
        worth = [np.broadcast_to(self.worth[:c], motion.shape),
                 np.broadcast_to(self.worth[c:], sensors.shape)]
        return (np.concatenate([motion.ravel(), sensors.ravel()]),
                np.concatenate([w.ravel() for w in worth]))


def measure(r: Residuals, blocks: tuple[NDArray[np.int64], NDArray[np.int64]],
            overlap: float = 2.0) -> Noise:
    """From the residuals of the base model; blocks: labels of windows (n,) and messages (m,).

    overlap: how often the windows predict every sample.
    """
    size = _size(r.motion)
    scaled = np.clip(r.motion / size, -CLIPPED, CLIPPED)
    covariance = scaled.T @ scaled / max(len(scaled), 1) + RIDGE * np.eye(scaled.shape[1])
    whitener = np.linalg.inv(np.linalg.cholesky(covariance)) / size
    sensors = np.maximum(_size(r.sensors), FINEST) if len(r.sensors) else np.ones(4)
    rough = Noise(whitener, sensors, np.ones(scaled.shape[1] + len(sensors)))
    motion, read = rough.whiten(r)
    worth = np.concatenate([np.minimum(_worth(motion, blocks[0]), 1.0 / overlap),
                            _worth(read - np.median(read, axis=0) if len(read) else read,
                                   blocks[1])])
    return Noise(whitener, sensors, worth)


def loss(x: FloatArray) -> FloatArray:
    """Soft L1: the square for small x, 2 * ROBUST * |x| for large ones."""
    return np.asarray(2.0 * ROBUST**2 * (np.sqrt(1.0 + (x / ROBUST)**2) - 1.0))


def weight(x: FloatArray) -> FloatArray:
    """Of the equivalent least squares."""
    return np.asarray(1.0 / np.sqrt(1.0 + (x / ROBUST)**2))


def _size(x: FloatArray) -> FloatArray:
    """Robust standard deviation of each column about its median."""
    middle = np.nanmedian(x, axis=0) if len(x) else np.zeros(x.shape[1])
    spread = np.nanmedian(np.abs(x - middle), axis=0) if len(x) else np.ones(x.shape[1])
    return np.asarray(np.where(np.isfinite(spread), 1.4826 * spread, 1.0) + 1e-6)


def _worth(x: FloatArray, block: NDArray[np.int64]) -> FloatArray:
    """Independent values per value, of each column: at most 1."""
    if not len(x):
        return np.ones(x.shape[1])
    _, index = np.unique(block, return_inverse=True)
    clipped = np.clip(x, -CLIPPED, CLIPPED)
    out = []
    for column in clipped.T:
        if not column.any():  # nothing was read there
            out.append(1.0)
            continue
        sums = np.bincount(index, column)
        out.append(min(1.0, float(column @ column) / max(float(sums @ sums), 1e-9)))
    return np.array(out)
