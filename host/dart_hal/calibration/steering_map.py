"""Fit the paper's five-parameter steering map.

    delta(s) = W A_L tanh(k_L (s + s0)) + (1 - W) A_R tanh(k_R (s + s0))

is measured as

    atan(l W/v) = delta - K v^2 sin(2 delta)/2

with K [s2/m2] the understeer of the tyres. A weak prior at a typical 1:10 car keeps a side without
data finite. It has the weight of one sample.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from dart_hal.calibration import curves
from dart_hal.calibration.samples import LEVEL_WIDTH, Samples
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import leverage_covariance
from dart_hal.vehicle.fitting.least_squares import Solution, fit_curve
from dart_hal.vehicle.fitting.robust import SOFT_L1_STDS, scatter
from dart_hal.vehicle.parameters import Steering

# Bounds, and mean and one sigma of the prior: k_left, a_left_rad, s0, a_right_rad, k_right.
MAP_LOW = np.array([0.1, 0.1, -0.4, 0.1, 0.1])
MAP_HIGH = np.array([5.0, 1.2, 0.4, 1.2, 5.0])
TYPICAL_MAP = np.array([1.5, 0.35, 0.0, 0.40, 1.5])
MAP_PRIOR_STD = np.array([2.0, 0.5, 0.5, 0.5, 2.0])
# rad; noise at which the prior has the weight of one sample.
ANGLE_NOISE = 0.02
# Levels of command, and their span, that a map needs.
MIN_LEVELS = 4
MIN_SPAN = 0.2
# rad; samples without noise would have no scale for the robust loss.
MIN_SCATTER = 1e-4


@dataclass(frozen=True, slots=True)
class PaperMap:
    """Fitted map. solution: residuals [rad] of the samples, then 5 of the prior.

    covariance (5, 5) of the parameters k_left, a_left_rad, s0, a_right_rad, k_right.
    """

    solution: Solution
    covariance: FloatArray

    @property
    def parameters(self) -> FloatArray:
        return self.solution.x

    def angle(self, command: FloatArray) -> FloatArray:
        """Road-wheel angle [rad] at command (n,)."""
        return curves.steering(self.parameters, command)[0]

    def std(self, command: FloatArray) -> FloatArray:
        """One sigma (n,) of ``angle`` [rad], provided that the form is exact."""
        slopes = curves.steering(self.parameters, command)[1]
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", slopes, self.covariance, slopes)))

    def as_dict(self) -> dict[str, float]:
        """Return the parameters by name."""
        return asdict(Steering(*map(float, self.parameters)))


def coverage(samples: Samples) -> tuple[int, float, bool]:
    """(levels of command, their span, whether the angle rises with the command)."""
    rising = np.cov(samples.command, samples.angle, aweights=samples.weight)[0, 1] > 0.0
    return (len(np.unique(np.round(samples.command / LEVEL_WIDTH))), float(np.ptp(samples.command)),
            bool(rising))


def fit_map(samples: Samples, *, block: IntArray | None = None, square: FloatArray | None = None,
            understeer: tuple[float, float] = (0.0, 0.0), robust: bool = False) -> PaperMap:
    """Fit by weighted least squares; covariance by a jackknife over blocks.

    block (n,): samples of one block share their errors; None = blocks of ``samples``. square (n,):
    v^2. understeer: K and its one sigma [s2/m2], which is propagated into the covariance. robust:
    soft L1 beyond three times the scatter.
    """
    square = np.zeros(len(samples)) if square is None else square
    root = np.sqrt(samples.weight)
    prior = ANGLE_NOISE / MAP_PRIOR_STD
    bounds = (MAP_LOW.tolist(), MAP_HIGH.tolist())

    def model(x: FloatArray) -> curves.Curve:
        delta, slopes = curves.steering(x, samples.command)
        slip = understeer[0] * square
        measured = root * (delta - 0.5 * slip * np.sin(2.0 * delta))
        by_delta = root * (1.0 - slip * np.cos(2.0 * delta))
        return (np.concatenate([measured, prior * x]),
                np.concatenate([by_delta[:, None] * slopes, np.diag(prior)]))

    target = np.concatenate([root * samples.angle, prior * TYPICAL_MAP])
    found = fit_curve(model, target, TYPICAL_MAP.tolist(), bounds)
    if robust:
        beyond = SOFT_L1_STDS * max(scatter(found.residual), MIN_SCATTER)
        found = fit_curve(model, target, found.x.tolist(), bounds, robust=beyond)
    label = np.unique(samples.block if block is None else block, return_inverse=True)[1]
    covariance = leverage_covariance(found, np.append(label, label.max() + 1 + np.arange(5)))
    # Shift of the parameters by one sigma of K: (J^T W J)^-1 J^T W d residual / dK.
    delta = curves.steering(found.x, samples.command)[0]
    effect = np.append(-0.5 * root * square * np.sin(2.0 * delta), np.zeros(5))
    weighted = found.jacobian * found.weight[:, None]
    shift = np.linalg.pinv(weighted.T @ found.jacobian) @ (weighted.T @ effect) * understeer[1]
    return PaperMap(found, np.asarray(covariance + np.outer(shift, shift)))
