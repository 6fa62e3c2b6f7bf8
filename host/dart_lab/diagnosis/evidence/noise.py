"""Size and correlation of the residuals: whitening, weights, loss.

With e (n, c) the motion residuals in SI units, b blocks of time, c = ``robust``:

    r = e L^-T,  L L^T = robust covariance of e       read-outs of one window err together
    w = min(1, sum_i r_i^2 / sum_b (sum_(i in b) r_i)^2)     and so do neighbours, by channel
    rho(r) = 2 c^2 (sqrt(1 + (r / c)^2) - 1)          soft L1: r^2 for small r

Sensors are divided by their robust standard deviation each. A command has an age of its own: in
published recordings nobody logs when it changed, in our own runs its pulse waits for the next
frame of the PWM. With s the standard deviation of ages and a the change of a read-out with age in
standard deviations per second, that read-out is first divided by sqrt(1 + s^2 a^2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.robust import scatter, soft_l1, soft_l1_weight

from ..policy import CLIP, MIN_READINGS, USUAL, NoisePolicy
from .residuals import Residuals
from .space import MAX_COMMAND_AGE

WIDEST = MAX_COMMAND_AGE / np.sqrt(12.0)  # s; standard deviation of ages of which nothing is known
DIVERGED = 1e3  # m/s, rad/s: beyond all that a car does, so that the limit of a residual counts
ROUNDS = 3  # of sizes and ages, each without the other


def replace_diverged(errors: FloatArray) -> FloatArray:
    """Return errors with DIVERGED for those of a prediction that is not finite."""
    if np.isfinite(errors).all():
        return errors
    return np.nan_to_num(errors, nan=DIVERGED, posinf=DIVERGED, neginf=-DIVERGED)


@dataclass(frozen=True, slots=True)
class Noise:
    """motion (c, c) whitens a row of motion residuals; sensors (4,): sizes; weight (c + 4,).

    certain (n, c): motion is first multiplied by it; below 1 where the age of a command
    moves a read-out.
    """

    motion: FloatArray
    sensors: FloatArray
    weight: FloatArray
    certain: FloatArray | float = 1.0
    policy: NoisePolicy = USUAL.noise

    def whiten(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations, (n, c) and (m, 4), wild ones held down."""
        motion = (replace_diverged(r.motion) * self.certain) @ self.motion.T
        sensors = np.nan_to_num(r.sensors / self.sensors, nan=0.0)
        wild = self.policy.wild
        return np.clip(motion, -wild, wild), np.clip(sensors, -wild, wild)

    def loss(self, x: FloatArray) -> FloatArray:
        """Of residuals in standard deviations: their square for small, linear for large ones."""
        return soft_l1(x, self.policy.robust)

    def robust_weight(self, x: FloatArray) -> FloatArray:
        """Of the equivalent least squares."""
        return soft_l1_weight(x, self.policy.robust)

    def with_motion(self, other: Noise) -> Noise:
        """The same with the motion of another."""
        c = len(self.motion)
        return replace(other, sensors=self.sensors,
                       weight=np.concatenate([other.weight[:c], self.weight[c:]]))

    @property
    def log_volume(self) -> float:
        """Sum of the logarithms of the standard deviations of all independent directions."""
        motion = -float(np.linalg.slogdet(self.motion)[1])
        return motion + float(np.log(self.sensors).sum())

    def instead_of(self, other: Noise, rows: FloatArray, windows: int) -> FloatArray:
        """Stacked rows (N, k) of n windows that another has whitened, as this one would."""
        c, k = len(self.motion), rows.shape[1]
        motion = rows[:windows * c].reshape(windows, c, k).transpose(0, 2, 1)
        si = motion @ np.linalg.inv(other.motion).T
        certain = np.broadcast_to(np.asarray(self.certain) / other.certain, (windows, c))
        motion = (si * certain[:, None]) @ self.motion.T
        sensors = rows[windows * c:].reshape(-1, len(self.sensors), k)
        sensors = sensors * (other.sensors / self.sensors)[:, None]
        return np.concatenate([motion.transpose(0, 2, 1).reshape(-1, k), sensors.reshape(-1, k)])

    def stacked(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """(residuals in standard deviations, the weight of each), (N,) both."""
        motion, sensors = self.whiten(r)
        c = motion.shape[1]
        weight = [np.broadcast_to(self.weight[:c], motion.shape),
                 np.broadcast_to(self.weight[c:], sensors.shape)]
        return (np.concatenate([motion.ravel(), sensors.ravel()]),
                np.concatenate([w.ravel() for w in weight]))


def measure(r: Residuals, blocks: tuple[IntArray, IntArray],
            overlap: float = 2.0, older: FloatArray | None = None,
            policy: NoisePolicy = USUAL.noise, wait: float | None = None) -> Noise:
    """From the residuals of the base model; blocks: labels of windows (n,) and messages (m,).

    overlap: how often the windows predict every sample. older (n, c): by how much the
    age of a command moves the motion at most [1/s], where each may have its own. wait [s]: the
    standard deviation of ages; None = as the residuals say.
    """
    certain = 1.0 if older is None else _certain(r.motion, older, policy, wait)
    whitener = _whitener(r.motion * certain, policy)
    finest = np.array([policy.encoder_floor, policy.gyro_floor, *[policy.accel_floor] * 2])
    sensors = np.maximum(_size(r.sensors), finest) if len(r.sensors) else np.ones(4)
    rough = Noise(whitener, sensors, np.ones(len(whitener) + len(sensors)), certain, policy)
    motion, read = rough.whiten(r)
    weight = np.concatenate([np.minimum(_weight(motion, blocks[0], CLIP), 1.0 / overlap),
                            _weight(read - np.median(read, axis=0) if len(read) else read,
                                   blocks[1], CLIP)])
    return replace(rough, weight=weight)


def _certain(motion: FloatArray, older: FloatArray, policy: NoisePolicy,
             wait: float | None) -> FloatArray:
    """Of residuals (n, c): standard deviation without ages over that with them."""
    certain = np.ones(motion.shape)
    for _ in range(ROUNDS):
        along = older / _size(motion * certain)
        own = _ages(motion, older, along, policy) if wait is None else wait**2
        if own is None:
            break
        if own < policy.age_s**2:
            return np.ones(motion.shape)
        certain = 1.0 / np.sqrt(1.0 + own * along**2)
    return certain


def _ages(motion: FloatArray, older: FloatArray, along: FloatArray, policy: NoisePolicy
          ) -> float | None:
    """Variance of ages [s2] by what residuals say where a command moves them most; None: nothing.

    along (n, c): ``older`` in standard deviations per second.
    """
    tells = along * MAX_COMMAND_AGE > 2.0 * policy.age_tells
    if tells.sum() < MIN_READINGS:
        return None
    age = np.clip(motion[tells] / older[tells], -MAX_COMMAND_AGE, MAX_COMMAND_AGE)
    return float(min(np.var(age) - np.mean(along[tells]**-2), WIDEST**2))


def _whitener(motion: FloatArray, policy: NoisePolicy) -> FloatArray:
    size = _size(motion)
    scaled = np.clip(motion / size, -CLIP, CLIP)
    covariance = scaled.T @ scaled / max(len(scaled), 1) + policy.ridge * np.eye(
        scaled.shape[1])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)) / size)


def _size(x: FloatArray) -> FloatArray:
    """Robust standard deviation of each column about its median."""
    out = np.ones(x.shape[1])
    for i, column in enumerate(x.T):
        told = column[np.isfinite(column)]
        if len(told):
            out[i] = scatter(told - np.median(told))
    return out + 1e-6


def _weight(x: FloatArray, block: IntArray, clip: float) -> FloatArray:
    """Independent values per value, of each column: at most 1."""
    if not len(x):
        return np.ones(x.shape[1])
    _, index = np.unique(block, return_inverse=True)
    clipped = np.clip(x, -clip, clip)
    out = []
    for column in clipped.T:
        if not column.any():  # nothing was read there
            out.append(1.0)
            continue
        sums = np.bincount(index, column)
        out.append(min(1.0, float(column @ column) / max(float(sums @ sums), 1e-9)))
    return np.array(out)
