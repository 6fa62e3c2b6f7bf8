"""Size and correlation of the residuals: whitening, weights, loss.

e (n, k): motion residuals in SI units, one row for each window. b: blocks of time. c = ``robust``.

    r = e L^-T,  L L^T = robust covariance of e, because the read-outs of one window are correlated
    w = min(1, sum_i r_i^2 / sum_b (sum_(i in b) r_i)^2)  for each column of r, because neighbours
                                                          in time are correlated
    rho(r) = 2 c^2 (sqrt(1 + (r / c)^2) - 1)              soft L1: r^2 for small r

Each sensor is divided by its robust standard deviation. The age of a command differs from message
to message: published recordings do not log when it changed, and in a run its pulse waits for the
next frame of the PWM. With s the standard deviation of ages and a the change of a read-out with age
in standard deviations per second, that read-out is first divided by sqrt(1 + s^2 a^2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.robust import scatter, soft_l1, soft_l1_weight

from .policy import CLIP, MIN_READINGS, USUAL_NOISE, NoisePolicy
from .residuals import Residuals
from .space import MAX_COMMAND_AGE

# Standard deviation of a uniform distribution over all possible ages.
UNKNOWN_AGE_STD = MAX_COMMAND_AGE / np.sqrt(12.0)  # s
# Rounded readings are not more accurate: half a millisecond of the encoder's jitter at 4 m/s2
# [m/s], steps of 1/16 deg/s [rad/s] and of 0.01 m/s2 (BNO055) over sqrt(12), for SENSORS.
RESOLUTION = np.array([0.002, 0.00031, 0.0029, 0.0029])
DIVERGED = 1e3  # m/s, rad/s; more than any car reaches, so the residual is clipped at its limit
ALTERNATIONS = 3  # estimates of noise and of ages, each given the other


def replace_diverged(errors: FloatArray) -> FloatArray:
    """Return errors with DIVERGED for those of a prediction that is not finite."""
    if np.isfinite(errors).all():
        return errors
    return np.nan_to_num(errors, nan=DIVERGED, posinf=DIVERGED, neginf=-DIVERGED)


@dataclass(frozen=True, slots=True)
class Noise:
    """Scale, correlation and weights of residuals.

    motion (c, c): matrix that whitens a row of motion residuals. sensors (4,): standard deviations.
    weight (c + 4,): independent values per value, at most 1. age_scale (n, c): motion is first
    multiplied by it; below 1 where the age of a command changes a read-out. Fits with equal weights
    of the recordings have the weight of each recording there instead, see ``final_fit``.
    """

    motion: FloatArray
    sensors: FloatArray
    weight: FloatArray
    age_scale: FloatArray | float = 1.0
    policy: NoisePolicy = USUAL_NOISE

    def whiten(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """Return residuals in standard deviations, (n, c) and (m, 4), clipped at the largest."""
        motion = (replace_diverged(r.motion) * self.age_scale) @ self.motion.T
        sensors = np.nan_to_num(r.sensors / self.sensors, nan=0.0)
        limit = self.policy.max_residual
        return np.clip(motion, -limit, limit), np.clip(sensors, -limit, limit)

    def loss(self, x: FloatArray) -> FloatArray:
        """Compute rho of residuals in standard deviations: squares, linear for large ones."""
        return soft_l1(x, self.policy.robust)

    def robust_weight(self, x: FloatArray) -> FloatArray:
        """Return the weights of the equivalent least squares."""
        return soft_l1_weight(x, self.policy.robust)

    def with_motion(self, other: Noise) -> Noise:
        """Return this noise with the motion of another."""
        c = len(self.motion)
        return replace(other, sensors=self.sensors,
                       weight=np.concatenate([other.weight[:c], self.weight[c:]]))

    @property
    def log_volume(self) -> float:
        """Sum of the logarithms of the standard deviations in all independent directions."""
        motion = -float(np.linalg.slogdet(self.motion)[1])
        return motion + float(np.log(self.sensors).sum())

    def rewhiten(self, other: Noise, rows: FloatArray, windows: int) -> FloatArray:
        """Whiten stacked rows (N, k) again that another noise has whitened; windows: n."""
        c = len(self.motion)
        k = rows.shape[1]
        motion = rows[:windows * c].reshape(windows, c, k).transpose(0, 2, 1)
        # Undo the other whitening, which gives SI units, and apply this one.
        si = motion @ np.linalg.inv(other.motion).T
        scale = np.broadcast_to(np.asarray(self.age_scale) / other.age_scale, (windows, c))
        motion = (si * scale[:, None]) @ self.motion.T
        sensors = rows[windows * c:].reshape(-1, len(self.sensors), k)
        sensors = sensors * (other.sensors / self.sensors)[:, None]
        return np.concatenate([motion.transpose(0, 2, 1).reshape(-1, k), sensors.reshape(-1, k)])

    def stack(self, r: Residuals) -> tuple[FloatArray, FloatArray]:
        """Return residuals in standard deviations (N,) and their weights (N,)."""
        motion, sensors = self.whiten(r)
        c = motion.shape[1]
        weight = [np.broadcast_to(self.weight[:c], motion.shape),
                 np.broadcast_to(self.weight[c:], sensors.shape)]
        return (np.concatenate([motion.ravel(), sensors.ravel()]),
                np.concatenate([w.ravel() for w in weight]))


def estimate_noise(r: Residuals, blocks: tuple[IntArray, IntArray],
                   overlap: float = 2.0, sensitivity: FloatArray | None = None,
                   policy: NoisePolicy = USUAL_NOISE, age_std: float | None = None) -> Noise:
    """Estimate the noise from the residuals of a model.

    blocks: labels of windows (n,) and messages (m,). overlap: number of windows that predict each
    sample. sensitivity (n, c): as ``age_sensitivity`` returns it [1/s]; None if all commands have
    one age. age_std [s]: standard deviation of ages; None: estimated from the residuals.
    """
    age_scale = 1.0 if sensitivity is None else _age_scale(r.motion, sensitivity, policy, age_std)
    # 1. Scale and correlation of the motion; a row is then a vector of independent numbers.
    whitener = _whitener(r.motion * age_scale, policy)
    resolution = RESOLUTION
    # 2. Scale of each sensor, not below the rounding of its readings.
    sensors = np.maximum(_robust_std(r.sensors), resolution) if len(r.sensors) else np.ones(4)
    unweighted = Noise(whitener, sensors, np.ones(len(whitener) + len(sensors)), age_scale, policy)
    motion, read = unweighted.whiten(r)
    # 3. Weights: residuals are correlated in time, so n of them are worth fewer independent ones.
    #    Overlapping windows predict each sample several times.
    centred = read - np.median(read, axis=0) if len(read) else read
    weight = np.concatenate([
        np.minimum(_effective_weight(motion, blocks[0], CLIP), 1.0 / overlap),
        _effective_weight(centred, blocks[1], CLIP)])
    return replace(unweighted, weight=weight)


def _age_scale(motion: FloatArray, sensitivity: FloatArray, policy: NoisePolicy,
               age_std: float | None) -> FloatArray:
    """Return 1 / sqrt(1 + s^2 a^2) for residuals (n, c).

    The noise without ages gives a, with it the variance s^2 of ages follows, and so on in turn.
    """
    scale = np.ones(motion.shape)
    for _ in range(ALTERNATIONS):
        # An age that deviates by t from the mean adds a t to a residual, in standard deviations of
        # the other noise. Over all ages the variance of the residual is 1 + s^2 a^2.
        relative = sensitivity / _robust_std(motion * scale)
        variance = (_age_variance(motion, sensitivity, relative, policy) if age_std is None
                    else age_std**2)
        if variance is None:
            break
        if variance < policy.age_s**2:
            return np.ones(motion.shape)
        scale = 1.0 / np.sqrt(1.0 + variance * relative**2)
    return scale


def _age_variance(motion: FloatArray, sensitivity: FloatArray, relative: FloatArray,
                  policy: NoisePolicy) -> float | None:
    """Estimate the variance of ages [s2] where a command changes the motion most; None: unknown.

    relative (n, c): a, the ``sensitivity`` in standard deviations per second. A residual over its
    sensitivity is an age, with 1 / relative^2 as the variance of its noise.
    """
    informative = relative * MAX_COMMAND_AGE > 2.0 * policy.min_age_effect
    if informative.sum() < MIN_READINGS:
        return None
    # var(residual / sensitivity) = s^2 + 1 / a^2: subtract the mean of the second term.
    age = motion[informative] / sensitivity[informative]
    age = np.clip(age, -MAX_COMMAND_AGE, MAX_COMMAND_AGE)
    noise = np.mean(relative[informative]**-2)
    return float(min(np.var(age) - noise, UNKNOWN_AGE_STD**2))


def _whitener(motion: FloatArray, policy: NoisePolicy) -> FloatArray:
    """Return L^-1 of the robust covariance L L^T: clipped residuals, with a ridge."""
    size = _robust_std(motion)
    scaled = np.clip(motion / size, -CLIP, CLIP)
    # With the covariance L L^T of rows, L^-1 row has the covariance I.
    covariance = scaled.T @ scaled / max(len(scaled), 1) + policy.ridge * np.eye(
        scaled.shape[1])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)) / size)


def _robust_std(x: FloatArray) -> FloatArray:
    """Return the robust standard deviation of each column about its median."""
    out = np.ones(x.shape[1])
    for i, column in enumerate(x.T):
        finite = column[np.isfinite(column)]
        if len(finite):
            out[i] = scatter(finite - np.median(finite))
    return out + 1e-6


def _effective_weight(x: FloatArray, block: IntArray, clip: float) -> FloatArray:
    """Return independent values per value of each column, at most 1.

    With correlation within blocks the square of a block's sum exceeds the sum of its squares.
    """
    if not len(x):
        return np.ones(x.shape[1])
    _, index = np.unique(block, return_inverse=True)
    clipped = np.clip(x, -clip, clip)
    out = []
    for column in clipped.T:
        if not column.any():  # no readings
            out.append(1.0)
            continue
        sums = np.bincount(index, column)
        out.append(min(1.0, float(column @ column) / max(float(sums @ sums), 1e-9)))
    return np.array(out)
