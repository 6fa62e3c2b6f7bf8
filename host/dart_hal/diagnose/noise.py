"""How large and how alike the residuals are, so that each counts for what it tells.

Read-outs of one window share their disturbance: they are whitened by their
own covariance. Windows and messages in a row share it too: a channel counts
less by as much as its sums over blocks vary more than independent values would.
A command that came at a time of its own is off by what that does: where nobody
logs when commands change, each read-out counts less by as much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dart_hal.fitting.robust import scatter, soft_l1, soft_l1_weight
from dart_hal.types import FloatArray

from .residuals import Residuals
from .space import AHEAD

ROBUST = 3.0  # standard deviations from where on a residual counts by its size
WILD = 30.0  # no residual counts as more
CLIPPED = 4.0  # for the estimates of this module
FINEST = np.array([0.002, 0.0, 0.0, 0.0])
"""Of SENSORS: no reading is told better. Half a millisecond at 4 m/s2 is 2 mm/s of an encoder."""
RIDGE = 0.02  # of a variance; keeps the covariance of few windows invertible
UNTOLD = 0.002  # s; ages of commands that differ by less do nothing
WIDEST = AHEAD / np.sqrt(12.0)  # s; standard deviation of ages of which nothing is known
TELLS, FEW = 3.0, 20
"""Standard deviations that the oldest command moves a read-out which tells its age; such read-outs,
from how many on they tell how far ages differ."""
ROUNDS = 3  # of sizes and ages, each without the other


@dataclass(frozen=True, slots=True)
class Noise:
    """motion (c, c) whitens a row of motion residuals; sensors (4,): sizes; worth (c + 4,).

    certain (n, c): motion is first multiplied by it; below 1 where the age of a command
    moves a read-out.
    """

    motion: FloatArray
    sensors: FloatArray
    worth: FloatArray
    certain: FloatArray | float = 1.0

    def whiten(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations, (n, c) and (m, 4), wild ones held down."""
        motion = np.nan_to_num(r.motion, nan=1e3, posinf=1e3, neginf=-1e3)
        motion = (motion * self.certain) @ self.motion.T
        sensors = np.nan_to_num(r.sensors / self.sensors, nan=0.0)
        return np.clip(motion, -WILD, WILD), np.clip(sensors, -WILD, WILD)

    def with_motion(self, other: Noise) -> Noise:
        """The same with the motion of another."""
        c = len(self.motion)
        return replace(other, sensors=self.sensors,
                       worth=np.concatenate([other.worth[:c], self.worth[c:]]))

    def stacked(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """(residuals in standard deviations, what each is worth), (N,) both."""
        motion, sensors = self.whiten(r)
        c = motion.shape[1]
        worth = [np.broadcast_to(self.worth[:c], motion.shape),
                 np.broadcast_to(self.worth[c:], sensors.shape)]
        return (np.concatenate([motion.ravel(), sensors.ravel()]),
                np.concatenate([w.ravel() for w in worth]))


def measure(r: Residuals, blocks: tuple[NDArray[np.int64], NDArray[np.int64]],
            overlap: float = 2.0, older: FloatArray | None = None) -> Noise:
    """From the residuals of the base model; blocks: labels of windows (n,) and messages (m,).

    overlap: how often the windows predict every sample. older (n, c): by how much the
    age of a command moves the motion at most [1/s], where each may have its own.
    """
    certain = 1.0 if older is None else _certain(r.motion, older)
    whitener = _whitener(r.motion * certain)
    sensors = np.maximum(_size(r.sensors), FINEST) if len(r.sensors) else np.ones(4)
    rough = Noise(whitener, sensors, np.ones(len(whitener) + len(sensors)), certain)
    motion, read = rough.whiten(r)
    worth = np.concatenate([np.minimum(_worth(motion, blocks[0]), 1.0 / overlap),
                            _worth(read - np.median(read, axis=0) if len(read) else read,
                                   blocks[1])])
    return replace(rough, worth=worth)


def _certain(motion: FloatArray, older: FloatArray) -> FloatArray:
    """Of residuals (n, c): standard deviation without ages over that with them.

    How far ages differ is what residuals say where a command moves them most.
    """
    certain = np.ones(motion.shape)
    for _ in range(ROUNDS):
        along = older / _size(motion * certain)
        tells = along * AHEAD > 2.0 * TELLS
        if tells.sum() < FEW:
            break
        age = np.clip(motion[tells] / older[tells], -AHEAD, AHEAD)
        own = min(float(np.var(age) - np.mean(along[tells]**-2)), WIDEST**2)
        if own < UNTOLD**2:
            return np.ones(motion.shape)
        certain = 1.0 / np.sqrt(1.0 + own * along**2)
    return certain


def _whitener(motion: FloatArray) -> FloatArray:
    size = _size(motion)
    scaled = np.clip(motion / size, -CLIPPED, CLIPPED)
    covariance = scaled.T @ scaled / max(len(scaled), 1) + RIDGE * np.eye(scaled.shape[1])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)) / size)


def loss(x: FloatArray) -> FloatArray:
    """Soft L1: the square for small x, 2 * ROBUST * |x| for large ones."""
    return soft_l1(x, ROBUST)


def weight(x: FloatArray) -> FloatArray:
    """Of the equivalent least squares."""
    return soft_l1_weight(x, ROBUST)


def _size(x: FloatArray) -> FloatArray:
    """Robust standard deviation of each column about its median."""
    out = np.ones(x.shape[1])
    for i, column in enumerate(x.T):
        told = column[np.isfinite(column)]
        if len(told):
            out[i] = scatter(told - np.median(told))
    return out + 1e-6


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
