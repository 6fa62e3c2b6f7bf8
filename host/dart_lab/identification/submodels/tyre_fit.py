"""Fit of the tyre curves: magic formula in front, a straight line behind.

    F_f = D sin(C atan(s - E (s - atan s))),  s = B (alpha_f + psi_i + trim_i)
    F_r = C_r (alpha_r + psi_i)

Recording i has its own yaw error psi_i of the markers, which shifts both slip angles, and trim_i
of the steering, which shifts the front's. Priors of what mounting and linkage allow keep them
near zero, so that they do not pass for grip. A drive that does not reach the peak determines the
curve, but neither C nor E: priors of what tyres have keep these two, and their errors are part
of those of D and B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import (
    enclosing_covariance,
    leverage_scores,
    pool_blocks,
    scaled_inverse,
    select_blocks,
)
from dart_hal.vehicle.fitting.least_squares import Solution, least_squares
from dart_hal.vehicle.fitting.robust import SOFT_L1_STDS, scatter, soft_l1
from dart_lab.identification.submodels.tyre_forces import TyreForces, is_rear_slip_small

# [rad] 6.9 deg: the rear's force is not linear beyond it.
MAX_REAR_SLIP = 0.12
# [rad] Prior standard deviations of psi_i and trim_i.
YAW_STD = 0.01
TRIM_STD = 0.02
# C, E: mean and standard deviation of lateral tyre curves. C 1.3 and E from 0 to -2 are usual
# (H. B. Pacejka, "Tire and Vehicle Dynamics", chapter 4); the paper's tyre has 0.69 and -3.07.
SHAPE_MEAN = np.array([1.2, -1.0])
SHAPE_STD = np.array([0.4, 2.0])
# C, E at which curves are fitted to find how far D and B vary with them.
SHAPES = tuple(product(np.linspace(0.4, 1.8, 8).tolist(), (-5.0, -3.0, -1.0, 0.0, 0.8)))
# Standard deviation over SHAPE_STD of a shape that is fixed.
FIXED_SHARE = 1e-3
# Samples that share one error (1 s): the priors are weighed against that many.
CORRELATED_SAMPLES = 10.0
# Bounds of D [N], C, B [1/rad], E, C_r [N/rad] of a car of 1:10.
MIN_PARAMETERS = np.array([0.2, 0.3, 0.5, -20.0, 1.0])
MAX_PARAMETERS = np.array([60.0, 2.0, 150.0, 1.0, 300.0])
# Indices of C and E.
SHAPE = (1, 3)
# Relative error of D, B and C_r from kernels and products of smoothed values, with a kernel of so
# many samples; it grows with the square of the kernel's length. In ten simulated cars C_r was 1.7 %
# too small with this one, and 4.3 % with the 25 samples for poses of 20 Hz.
SYSTEMATIC_SHARE = 0.02
SYSTEMATIC_KERNEL_LENGTH = 15


@dataclass(frozen=True, slots=True)
class TyreFit:
    """Fitted tyre curves.

    x (5,): D [N], C, B [1/rad], E, C_r [N/rad]; covariance (5, 5), with the priors of C and E;
    front, rear: residuals [N]; force_ratios: (front, rear) of each recording, measured force over
    the model's.
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


def find_stiffness_std(x: FloatArray, covariance: FloatArray) -> float:
    """Return the standard error of B C D [N/rad] for x (D, C, B, E, C_r)."""
    d, c, b = x[:3].tolist()
    slope = np.array([b * c, b * d, c * d, 0.0, 0.0])
    return float(np.sqrt(slope @ covariance @ slope))


def magic_formula(x: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return F = D sin(C atan(s - E (s - atan s))), s = B alpha, and its derivatives (5, n).

    The derivatives are by D, C, B, E, alpha; x: D, C, B, E.
    """
    d, c, b, e = x[:4].tolist()
    slip = b * alpha
    bent = np.arctan(slip)
    inner = slip - e * (slip - bent)
    angle = np.arctan(inner)
    sine = np.sin(c * angle)
    cosine = np.cos(c * angle)
    # dF / d inner, and d inner / d slip.
    outer = d * cosine * c / (1.0 + inner**2)
    slope = outer * (1.0 - e + e / (1.0 + slip**2))
    return d * sine, np.stack([sine, d * cosine * angle, slope * alpha, outer * (bent - slip),
                               slope * b])


def fit_curves(parts: Sequence[TyreForces], shape: FloatArray | None = None, *,
               with_spread: bool = True) -> TyreFit:
    """Fit one curve to all recordings. shape (2,): C and E if they are fixed, else priors.

    1. A pass with unit noise and no robust loss. Its residuals give the noise of front and rear.
    2. A pass with this noise and a robust loss. Covariance by the sandwich.
    3. With free C and E and with_spread, the spread of the fits at ``SHAPES`` is added: D, C, B
       and E replace each other along a curved ridge, which the sandwich takes for straight.
    """
    masks = [is_rear_slip_small(p, MAX_REAR_SLIP) for p in parts]
    noise = np.ones(2)
    start = _guess(parts, masks)
    for robust in (None, SOFT_L1_STDS):
        problem = _TyreProblem(parts, masks, noise, shape)
        solution = problem.solve(start, robust)
        front, rear = problem.split(solution.residual)
        noise = np.array([scatter(front), scatter(rear)]) * noise
        start = solution.x
    full = solution.x[:5]
    covariance = problem.covariance(solution)
    if shape is None and with_spread:
        covariance = enclosing_covariance(covariance, _spread_over_shapes(problem, solution))
    is_shape = np.isin(np.arange(5), SHAPE)
    share = SYSTEMATIC_SHARE * np.mean([(len(p.kernel) / SYSTEMATIC_KERNEL_LENGTH)**2
                                        for p in parts])
    covariance += np.diag(np.where(is_shape, 0.0, share * full)**2)
    front, rear = problem.split(solution.residual)
    # E is at most 1, and the prior allows it: C and E at a bound do not make a fit unsound.
    stopped = solution.at_bound[:5] & ~is_shape
    return TyreFit(full, covariance, solution.converged, tuple(map(bool, stopped)),
                   front * problem.noise[0], rear * problem.noise[1],
                   problem.force_ratios(solution.x))


def _spread_over_shapes(problem: _TyreProblem, solution: Solution) -> FloatArray:
    """Compute the second moment (5, 5) about the solution of the fits at ``SHAPES``.

    Each counts by its posterior probability exp(-L / 2), L the robust loss with the priors over
    ``CORRELATED_SAMPLES``.
    """
    slip = np.concatenate([part.alpha_f[part.rows] for part in problem.parts])
    largest = float(np.quantile(np.abs(slip), 0.95))
    criterion = []
    points = []
    for shape in SHAPES:
        fixed = replace(problem, shape=np.array(shape))
        found = fixed.solve(_reshape(solution.x, shape, largest), SOFT_L1_STDS, tolerance=1e-4)
        loss = float(np.sum(soft_l1(found.residual, SOFT_L1_STDS))) / CORRELATED_SAMPLES
        criterion.append(loss + float(np.sum(((shape - SHAPE_MEAN) / SHAPE_STD)**2)))
        points.append(found.x[:5] - solution.x[:5])
    probability = np.exp(-0.5 * (np.array(criterion) - min(criterion)))
    off = np.array(points)
    return np.asarray(np.einsum("s,si,sj->ij", probability / probability.sum(), off, off))


def _reshape(x: FloatArray, shape: tuple[float, float], alpha: float) -> FloatArray:
    """Return x with C and E replaced, and D and B such that slope and force at alpha stay."""
    force = float(magic_formula(x, np.array([alpha]))[0][0])
    stiffness = float(x[0] * x[1] * x[2])
    out: FloatArray = x.copy()
    out[list(SHAPE)] = shape
    for _ in range(5):
        out[2] = stiffness / (out[0] * out[1])
        out[0] *= force / float(magic_formula(out, np.array([alpha]))[0][0])
    return out


def _guess(parts: Sequence[TyreForces], masks: Sequence[BoolArray]) -> FloatArray:
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
    c, e = SHAPE_MEAN
    return np.array([peak, c, front / peak / c, e, rear] + [0.0] * (2 * len(parts)))


@dataclass(slots=True)
class _TyreProblem:
    """Residuals of the front's forces, of the rear's, and of the priors.

    x: D, C, B, E, C_r, then psi_i and trim_i of the recordings; shape (2,): fixed C and E.
    """

    parts: Sequence[TyreForces]
    masks: Sequence[BoolArray]
    noise: FloatArray
    shape: FloatArray | None

    @property
    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Mean (k,) and precision's square root (k,) of all parameters, 0: no prior."""
        r = len(self.parts)
        mean = np.zeros(5 + 2 * r)
        root = np.zeros(5 + 2 * r)
        mean[list(SHAPE)] = SHAPE_MEAN if self.shape is None else self.shape
        root[list(SHAPE)] = 1.0 / (SHAPE_STD * (1.0 if self.shape is None else FIXED_SHARE))
        root[5:] = np.repeat([1.0 / YAW_STD, 1.0 / TRIM_STD], r)
        return mean, root

    def solve(self, start: FloatArray, robust: float | None, tolerance: float = 1e-6) -> Solution:
        extra = np.full(2 * len(self.parts), 0.2)
        force = self.parts[0].force_scale
        size = np.array([force, 1.0, 1.0, 1.0, force])
        low, high = (np.append(size * MIN_PARAMETERS, -extra),
                     np.append(size * MAX_PARAMETERS, extra))
        return least_squares(self.residual, start.tolist(), (low.tolist(), high.tolist()),
                             jacobian=self.jacobian, robust=robust, tolerance=tolerance)

    def residual(self, x: FloatArray) -> FloatArray:
        return self._evaluate(x)[0]

    def jacobian(self, x: FloatArray) -> FloatArray:
        return self._evaluate(x, slopes=True)[1]

    def _evaluate(self, p: FloatArray, slopes: bool = False) -> tuple[FloatArray, FloatArray]:
        r = len(self.parts)
        front = []
        rear = []
        jac_f = []
        jac_r = []
        for i, (part, mask) in enumerate(zip(self.parts, self.masks, strict=True)):
            yaw = float(p[5 + i])
            trim = float(p[5 + r + i])
            force, slopes_f = magic_formula(p, part.alpha_f + yaw + trim)
            behind = part.smooth(part.alpha_r)[mask] + yaw
            front.append((part.smooth(force) - part.force_f) / self.noise[0])
            rear.append((p[4] * behind - part.force_r[mask]) / self.noise[1])
            if slopes:
                f = np.zeros((len(part.rows), 5 + 2 * r))
                b = np.zeros((len(behind), 5 + 2 * r))
                # Columns: D, C, B, E, C_r, then psi_i and trim_i, which both shift alpha.
                columns = [part.smooth(row) / self.noise[0] for row in slopes_f]
                f[:, :4] = np.stack(columns[:4], axis=1)
                f[:, 5 + i] = columns[4]
                f[:, 5 + r + i] = columns[4]
                b[:, 4] = behind / self.noise[1]
                b[:, 5 + i] = p[4] / self.noise[1]
                jac_f.append(f)
                jac_r.append(b)
        mean, root = self.prior
        weight = np.sqrt(CORRELATED_SAMPLES) * root
        residual = np.concatenate([*front, *rear, (weight * (p - mean))[root > 0.0]])
        if not slopes:
            return residual, residual
        return residual, np.concatenate([*jac_f, *jac_r, np.diag(weight)[root > 0.0]])

    def covariance(self, solution: Solution) -> FloatArray:
        """Covariance (5, 5) of the curves.

        The sandwich over blocks of the data, plus the errors of the priors. A prior of standard
        deviation s weighs ``CORRELATED_SAMPLES`` n / s^2, so one s of error is a gradient of n / s.
        """
        _, root = self.prior
        n = len(solution.residual) - int(np.count_nonzero(root))
        data = replace(solution, residual=solution.residual[:n], jacobian=solution.jacobian[:n],
                       weight=solution.weight[:n])
        precision = np.diag(root**2)
        weighted = data.jacobian * data.weight[:, None]
        inverse = scaled_inverse(weighted.T @ data.jacobian + CORRELATED_SAMPLES * precision)
        meat = leverage_scores(data, self.blocks(), inverse)
        meat += CORRELATED_SAMPLES**2 * precision
        return np.asarray(inverse @ meat @ inverse)[:5, :5]

    def split(self, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Split a residual into (front, rear); the rows of the priors are dropped."""
        n = sum(len(p.rows) for p in self.parts)
        priors = int(np.count_nonzero(self.prior[1]))
        return residual[:n], residual[n:len(residual) - priors]

    def blocks(self) -> IntArray:
        """Return the blocks of the residuals: recordings if there are 8, else 2 s each."""
        block = select_blocks(*pool_blocks([part.block for part in self.parts]))
        mask = np.concatenate(list(self.masks))
        return np.concatenate([block, block[mask]]).astype(np.int64)

    def force_ratios(self, p: FloatArray) -> tuple[tuple[float, float], ...]:
        """Return (front, rear) of each recording: slope of measured force over the model's."""
        out = []
        r = len(self.parts)
        for i, (part, mask) in enumerate(zip(self.parts, self.masks, strict=True)):
            yaw = float(p[5 + i])
            trim = float(p[5 + r + i])
            model = part.smooth(magic_formula(p, part.alpha_f + yaw + trim)[0])
            behind = p[4] * (part.smooth(part.alpha_r)[mask] + yaw)
            out.append((_slope(model, part.force_f), _slope(behind, part.force_r[mask])))
        return tuple(out)


def _slope(model: FloatArray, force: FloatArray) -> float:
    return float(model @ force / max(float(model @ model), 1e-9))
