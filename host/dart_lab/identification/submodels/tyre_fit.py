"""Magic formula in front, a straight line behind, with what each recording may have of its own.

Each recording may have a yaw error of its markers (it shifts both slip angles)
and a trim of its steering (it shifts the front's): held near zero by what
mounting and linkage allow, so that they do not pass for grip.
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
from dart_lab.identification.submodels.tyre_forces import TyreForces, usable

REAR_RANGE = 0.12  # rad; 6.9 deg: beyond it the rear is no straight line
YAW_STD, TRIM_STD = 0.01, 0.02  # rad
MEMORY = 10.0  # samples that share one error: 1 s
LOW, HIGH = np.array([0.2, 0.6, 0.5, 1.0]), np.array([60.0, 2.0, 150.0, 300.0])
SYSTEMATIC = 0.015  # of D, B and C_r: kernels, products of smoothed values, form of the curve


@dataclass(frozen=True, slots=True)
class TyreFit:
    """x (4,): D N, C, B 1/rad, C_r N/rad; covariance (4, 4); solution in units of ``noise`` (2,).

    front, rear: residuals in N; gains: per recording, force over model's force.
    """

    x: FloatArray
    covariance: FloatArray
    converged: bool
    stopped: tuple[bool, ...]
    front: FloatArray
    rear: FloatArray
    gains: tuple[tuple[float, float], ...]

    @property
    def stiffness(self) -> float:
        """B C D [N/rad]."""
        return float(self.x[0] * self.x[1] * self.x[2])

    @property
    def stiffness_std(self) -> float:
        """Its standard error."""
        d, c, b = self.x[:3].tolist()
        slope = np.array([b * c, b * d, c * d, 0.0])
        return float(np.sqrt(slope @ self.covariance @ slope))


def magic(x: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(force, slopes (4, n) by D, C, B, alpha) of D sin(C atan(B alpha))."""
    d, c, b = x[:3].tolist()
    angle = np.arctan(b * alpha)
    sine, cosine = np.sin(c * angle), np.cos(c * angle)
    inner = d * cosine * c / (1.0 + (b * alpha) ** 2)
    return d * sine, np.stack([sine, d * cosine * angle, inner * alpha, inner * b])


def fit_curves(parts: Sequence[TyreForces], shape: float | None) -> TyreFit:
    """All recordings together. shape: C held at this value, None = fitted."""
    masks = [usable(p, REAR_RANGE) for p in parts]
    noise = np.ones(2)
    start = _guess(parts, masks, shape)
    for robust in (None, SOFT_L1_STDS):
        problem = _Problem(parts, masks, noise, shape)
        solution = problem.solve(start, robust)
        front, rear = problem.split(solution.residual)
        noise = np.array([scatter(front), scatter(rear)]) * noise
        start = solution.x
    free = [0, 1, 2, 3] if shape is None else [0, 2, 3]
    covariance = np.zeros((4, 4))
    covariance[np.ix_(free, free)] = leverage_covariance(solution, problem.blocks())[:len(free),
                                                                                  :len(free)]
    full = problem.full(solution.x)
    covariance += np.diag(np.where(np.arange(4) == 1, 0.0, SYSTEMATIC * full[:4])**2)
    stopped = np.zeros(4, dtype=bool)
    stopped[free] = solution.at_bound[:len(free)]
    front, rear = problem.split(solution.residual)
    return TyreFit(full[:4], covariance, solution.converged, tuple(map(bool, stopped)),
                   front * problem.noise[0], rear * problem.noise[1], problem.gains(full))


def _guess(parts: Sequence[TyreForces], masks: Sequence[BoolArray], shape: float | None
           ) -> FloatArray:
    """Slopes through the origin; the front's greatest force as D."""
    alpha = np.concatenate([p.seen(p.alpha_f) for p in parts])
    force = np.concatenate([p.force_f for p in parts])
    small = np.abs(alpha) < 0.08
    use = small if small.sum() > 50 else np.ones(len(alpha), dtype=bool)
    front = max(float(alpha[use] @ force[use]) / max(float(alpha[use] @ alpha[use]), 1e-9), 2.0)
    behind = np.concatenate([p.seen(p.alpha_r)[m] for p, m in zip(parts, masks, strict=True)])
    pull = np.concatenate([p.force_r[m] for p, m in zip(parts, masks, strict=True)])
    rear = max(float(behind @ pull) / max(float(behind @ behind), 1e-9), 2.0)
    most = max(float(np.quantile(np.abs(force), 0.95)), 1.0)
    c = 1.2 if shape is None else shape
    x = [most, c, front / most / c, rear]
    return np.array([v for i, v in enumerate(x) if shape is None or i != 1]
                    + [0.0] * (2 * len(parts)))


@dataclass(slots=True)
class _Problem:
    parts: Sequence[TyreForces]
    masks: Sequence[BoolArray]
    noise: FloatArray
    shape: float | None

    def full(self, x: FloatArray) -> FloatArray:
        """x with C put in where it is held."""
        return x if self.shape is None else np.insert(x, 1, self.shape)

    def solve(self, start: FloatArray, robust: float | None) -> Solution:
        extra = np.full(2 * len(self.parts), 0.2)
        low, high = np.append(LOW, -extra), np.append(HIGH, extra)
        if self.shape is not None:
            low, high = np.delete(low, 1), np.delete(high, 1)
        return least_squares(self.residual, start.tolist(), (low.tolist(), high.tolist()),
                             jacobian=self.jacobian, robust=robust, tolerance=1e-6)

    def residual(self, x: FloatArray) -> FloatArray:
        return self._evaluate(x)[0]

    def jacobian(self, x: FloatArray) -> FloatArray:
        return self._evaluate(x, slopes=True)[1]

    def _evaluate(self, x: FloatArray, slopes: bool = False) -> tuple[FloatArray, FloatArray]:
        p, r = self.full(x), len(self.parts)
        front, rear, jac_f, jac_r = [], [], [], []
        for i, (part, mask) in enumerate(zip(self.parts, self.masks, strict=True)):
            yaw, trim = float(p[4 + i]), float(p[4 + r + i])
            force, by = magic(p, part.alpha_f + yaw + trim)
            behind = part.seen(part.alpha_r)[mask] + yaw
            front.append((part.seen(force) - part.force_f) / self.noise[0])
            rear.append((p[3] * behind - part.force_r[mask]) / self.noise[1])
            if slopes:
                f, b = np.zeros((len(part.rows), 4 + 2 * r)), np.zeros((len(behind), 4 + 2 * r))
                seen = [part.seen(row) / self.noise[0] for row in by]
                f[:, 0], f[:, 1], f[:, 2] = seen[:3]
                f[:, 4 + i] = f[:, 4 + r + i] = seen[3]
                b[:, 3], b[:, 4 + i] = behind / self.noise[1], p[3] / self.noise[1]
                jac_f.append(f)
                jac_r.append(b)
        prior = np.sqrt(MEMORY) / np.repeat([YAW_STD, TRIM_STD], r)
        residual = np.concatenate([*front, *rear, prior * p[4:]])
        if not slopes:
            return residual, residual
        tail = np.hstack([np.zeros((2 * r, 4)), np.diag(prior)])
        jac = np.concatenate([*jac_f, *jac_r, tail])
        return residual, jac if self.shape is None else np.delete(jac, 1, axis=1)

    def split(self, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(front, rear) of a residual."""
        n = sum(len(p.rows) for p in self.parts)
        return residual[:n], residual[n:len(residual) - 2 * len(self.parts)]

    def blocks(self) -> IntArray:
        """Recordings where there are 8 and more, else stretches of 2 s; priors with theirs."""
        block = select_blocks(*pool_blocks([part.block for part in self.parts]))
        mask = np.concatenate(list(self.masks))
        own = block.max() + 1 + np.arange(len(self.parts))
        return np.concatenate([block, block[mask], own, own]).astype(np.int64)

    def gains(self, p: FloatArray) -> tuple[tuple[float, float], ...]:
        """Per recording (front, rear): slope of the measured force over the model's."""
        out, r = [], len(self.parts)
        for i, (part, mask) in enumerate(zip(self.parts, self.masks, strict=True)):
            yaw, trim = float(p[4 + i]), float(p[4 + r + i])
            model = part.seen(magic(p, part.alpha_f + yaw + trim)[0])
            behind = p[3] * (part.seen(part.alpha_r)[mask] + yaw)
            out.append((_slope(model, part.force_f), _slope(behind, part.force_r[mask])))
        return tuple(out)


def _slope(model: FloatArray, force: FloatArray) -> float:
    return float(model @ force / max(float(model @ model), 1e-9))
