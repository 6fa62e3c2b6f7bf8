"""Fit of the tyre curves: magic formula in front, a straight line behind.

    F_f = D sin(C atan(B (alpha_f + psi_i + trim_i))),    F_r = C_r (alpha_r + psi_i)

Recording i has its own yaw error psi_i of the markers, which shifts both slip angles, and trim_i
of the steering, which shifts the front's. Priors of what mounting and linkage allow keep them
near zero, so that they do not pass for grip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import (
    leverage_covariance,
    pool_blocks,
    select_blocks,
)
from dart_hal.vehicle.fitting.least_squares import Solution, least_squares
from dart_hal.vehicle.fitting.robust import SOFT_L1_STDS, scatter
from dart_lab.identification.submodels.tyre_forces import TyreForces, is_rear_slip_small

# [rad] 6.9 deg: the rear's force is not linear beyond it.
MAX_REAR_SLIP = 0.12
# [rad] Prior standard deviations of psi_i and trim_i.
YAW_STD = 0.01
TRIM_STD = 0.02
# Samples that share one error (1 s): the priors are weighed against that many.
CORRELATED_SAMPLES = 10.0
# Bounds of D [N], C, B [1/rad], C_r [N/rad] of a car of 1:10.
MIN_PARAMETERS = np.array([0.2, 0.6, 0.5, 1.0])
MAX_PARAMETERS = np.array([60.0, 2.0, 150.0, 300.0])
# Relative error of D, B and C_r from kernels, products of smoothed values and the curve's form.
SYSTEMATIC_SHARE = 0.015


@dataclass(frozen=True, slots=True)
class TyreFit:
    """Fitted tyre curves.

    x (4,): D [N], C, B [1/rad], C_r [N/rad]; covariance (4, 4); front, rear: residuals [N];
    force_ratios: (front, rear) of each recording, measured force over the model's.
    """

    x: FloatArray
    covariance: FloatArray
    converged: bool
    stopped: tuple[bool, ...]
    front: FloatArray
    rear: FloatArray
    force_ratios: tuple[tuple[float, float], ...]

    @property
    def stiffness(self) -> float:
        """Cornering stiffness of the front, B C D [N/rad]."""
        return float(self.x[0] * self.x[1] * self.x[2])

    @property
    def stiffness_std(self) -> float:
        """Standard error of the front's stiffness [N/rad]."""
        d, c, b = self.x[:3].tolist()
        slope = np.array([b * c, b * d, c * d, 0.0])
        return float(np.sqrt(slope @ self.covariance @ slope))


def magic_formula(x: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return F = D sin(C atan(B alpha)) and its derivatives (4, n) by D, C, B, alpha."""
    d, c, b = x[:3].tolist()
    angle = np.arctan(b * alpha)
    sine = np.sin(c * angle)
    cosine = np.cos(c * angle)
    inner = d * cosine * c / (1.0 + (b * alpha) ** 2)
    return d * sine, np.stack([sine, d * cosine * angle, inner * alpha, inner * b])


def fit_curves(parts: Sequence[TyreForces], shape: float | None) -> TyreFit:
    """Fit one curve to all recordings. shape: fixed value of C, None: C is fitted.

    The first pass has unit noise and no robust loss; its residuals give the noise of front and
    rear for the second pass.
    """
    masks = [is_rear_slip_small(p, MAX_REAR_SLIP) for p in parts]
    noise = np.ones(2)
    start = _guess(parts, masks, shape)
    for robust in (None, SOFT_L1_STDS):
        problem = _TyreProblem(parts, masks, noise, shape)
        solution = problem.solve(start, robust)
        front, rear = problem.split(solution.residual)
        noise = np.array([scatter(front), scatter(rear)]) * noise
        start = solution.x
    free = [0, 1, 2, 3] if shape is None else [0, 2, 3]
    covariance = np.zeros((4, 4))
    # The rows behind these are psi_i and trim_i.
    inner = leverage_covariance(solution, problem.blocks())[:len(free), :len(free)]
    covariance[np.ix_(free, free)] = inner
    full = problem.full(solution.x)
    covariance += np.diag(np.where(np.arange(4) == 1, 0.0, SYSTEMATIC_SHARE * full[:4])**2)
    stopped = np.zeros(4, dtype=bool)
    stopped[free] = solution.at_bound[:len(free)]
    front, rear = problem.split(solution.residual)
    return TyreFit(full[:4], covariance, solution.converged, tuple(map(bool, stopped)),
                   front * problem.noise[0], rear * problem.noise[1], problem.force_ratios(full))


def _guess(parts: Sequence[TyreForces], masks: Sequence[BoolArray], shape: float | None
           ) -> FloatArray:
    """Return a start: slopes through the origin, and the front's largest force as D."""
    alpha = np.concatenate([p.smooth(p.alpha_f) for p in parts])
    force = np.concatenate([p.force_f for p in parts])
    size = parts[0].force_scale
    small = np.abs(alpha) < 0.08
    use = small if small.sum() > 50 else np.ones(len(alpha), dtype=bool)
    slope = float(alpha[use] @ force[use]) / max(float(alpha[use] @ alpha[use]), 1e-9)
    front = max(slope, 2.0 * size)
    behind = np.concatenate([p.smooth(p.alpha_r)[m] for p, m in zip(parts, masks, strict=True)])
    pull = np.concatenate([p.force_r[m] for p, m in zip(parts, masks, strict=True)])
    rear = max(float(behind @ pull) / max(float(behind @ behind), 1e-9), 2.0 * size)
    peak = max(float(np.quantile(np.abs(force), 0.95)), size)
    c = 1.2 if shape is None else shape
    x = [peak, c, front / peak / c, rear]
    return np.array([v for i, v in enumerate(x) if shape is None or i != 1]
                    + [0.0] * (2 * len(parts)))


@dataclass(slots=True)
class _TyreProblem:
    parts: Sequence[TyreForces]
    masks: Sequence[BoolArray]
    noise: FloatArray
    shape: float | None

    def full(self, x: FloatArray) -> FloatArray:
        """Return x with C inserted where it is fixed."""
        return x if self.shape is None else np.insert(x, 1, self.shape)

    def solve(self, start: FloatArray, robust: float | None) -> Solution:
        extra = np.full(2 * len(self.parts), 0.2)
        size = np.array([self.parts[0].force_scale, 1.0, 1.0, self.parts[0].force_scale])
        low, high = (np.append(size * MIN_PARAMETERS, -extra),
                     np.append(size * MAX_PARAMETERS, extra))
        if self.shape is not None:
            low, high = np.delete(low, 1), np.delete(high, 1)
        return least_squares(self.residual, start.tolist(), (low.tolist(), high.tolist()),
                             jacobian=self.jacobian, robust=robust, tolerance=1e-6)

    def residual(self, x: FloatArray) -> FloatArray:
        return self._evaluate(x)[0]

    def jacobian(self, x: FloatArray) -> FloatArray:
        return self._evaluate(x, slopes=True)[1]

    def _evaluate(self, x: FloatArray, slopes: bool = False) -> tuple[FloatArray, FloatArray]:
        p = self.full(x)
        r = len(self.parts)
        front = []
        rear = []
        jac_f = []
        jac_r = []
        for i, (part, mask) in enumerate(zip(self.parts, self.masks, strict=True)):
            yaw = float(p[4 + i])
            trim = float(p[4 + r + i])
            force, slopes_f = magic_formula(p, part.alpha_f + yaw + trim)
            behind = part.smooth(part.alpha_r)[mask] + yaw
            front.append((part.smooth(force) - part.force_f) / self.noise[0])
            rear.append((p[3] * behind - part.force_r[mask]) / self.noise[1])
            if slopes:
                f = np.zeros((len(part.rows), 4 + 2 * r))
                b = np.zeros((len(behind), 4 + 2 * r))
                # Columns: D, C, B, C_r, then psi_i and trim_i, which both shift alpha.
                columns = [part.smooth(row) / self.noise[0] for row in slopes_f]
                f[:, :3] = np.stack(columns[:3], axis=1)
                f[:, 4 + i] = columns[3]
                f[:, 4 + r + i] = columns[3]
                b[:, 3] = behind / self.noise[1]
                b[:, 4 + i] = p[3] / self.noise[1]
                jac_f.append(f)
                jac_r.append(b)
        prior = np.sqrt(CORRELATED_SAMPLES) / np.repeat([YAW_STD, TRIM_STD], r)
        residual = np.concatenate([*front, *rear, prior * p[4:]])
        if not slopes:
            return residual, residual
        tail = np.hstack([np.zeros((2 * r, 4)), np.diag(prior)])
        jac = np.concatenate([*jac_f, *jac_r, tail])
        return residual, jac if self.shape is None else np.delete(jac, 1, axis=1)

    def split(self, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Split a residual into (front, rear); the rows of the priors are dropped."""
        n = sum(len(p.rows) for p in self.parts)
        return residual[:n], residual[n:len(residual) - 2 * len(self.parts)]

    def blocks(self) -> IntArray:
        """Return the blocks of the residuals: recordings if there are 8, else 2 s each."""
        block = select_blocks(*pool_blocks([part.block for part in self.parts]))
        mask = np.concatenate(list(self.masks))
        own = block.max() + 1 + np.arange(len(self.parts))
        return np.concatenate([block, block[mask], own, own]).astype(np.int64)

    def force_ratios(self, p: FloatArray) -> tuple[tuple[float, float], ...]:
        """Return (front, rear) of each recording: slope of measured force over the model's."""
        out = []
        r = len(self.parts)
        for i, (part, mask) in enumerate(zip(self.parts, self.masks, strict=True)):
            yaw = float(p[4 + i])
            trim = float(p[4 + r + i])
            model = part.smooth(magic_formula(p, part.alpha_f + yaw + trim)[0])
            behind = p[3] * (part.smooth(part.alpha_r)[mask] + yaw)
            out.append((_slope(model, part.force_f), _slope(behind, part.force_r[mask])))
        return tuple(out)


def _slope(model: FloatArray, force: FloatArray) -> float:
    return float(model @ force / max(float(model @ model), 1e-9))
