"""The one fit of the paper's five-parameter steering map, whatever rows it is made from.

delta(s) = W A_L tanh(k_L (s + s0)) + (1 - W) A_R tanh(k_R (s + s0)) is seen as
atan(l W/v) = delta - K v^2 sin(2 delta)/2, with K [s2/m2] the understeer of the
tyres. A weak prior around a typical 1:10 car keeps a side that the data do not
reach finite; it weighs as much as one sample.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from dart_hal.calibration import curves
from dart_hal.calibration.samples import LEVEL, Samples
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import leverage_covariance
from dart_hal.vehicle.fitting.least_squares import Solution, fit_curve
from dart_hal.vehicle.fitting.robust import SOFT_L1_STDS, scatter
from dart_hal.vehicle.parameters import Steering

LOW = np.array([0.1, 0.1, -0.4, 0.1, 0.1])
HIGH = np.array([5.0, 1.2, 0.4, 1.2, 5.0])
TYPICAL = np.array([1.5, 0.35, 0.0, 0.40, 1.5])
PRIOR_STD = np.array([2.0, 0.5, 0.5, 0.5, 2.0])
NOISE = 0.02  # rad; the scale at which the prior weighs as much as one sample
MIN_LEVELS, MIN_SPAN = 4, 0.2  # levels of command and their span that a map needs
LEAST_SCATTER = 1e-4  # rad; noise-free samples would have no robust loss


@dataclass(frozen=True, slots=True)
class SteeringMap:
    """parameters (5,): k_left, a_left_rad, s0, a_right_rad, k_right; covariance (5, 5).

    solution: residuals [rad] of the samples, then 5 of the prior.
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
        """One sigma (n,) of ``angle`` [rad] if the form is right."""
        slopes = curves.steering(self.parameters, command)[1]
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", slopes, self.covariance, slopes)))

    def as_dict(self) -> dict[str, float]:
        """The parameters by name."""
        return asdict(Steering(*map(float, self.parameters)))


def coverage(samples: Samples) -> tuple[int, float, bool]:
    """(levels of command, their span, whether the angle rises with the command)."""
    rising = np.cov(samples.command, samples.angle, aweights=samples.weight)[0, 1] > 0.0
    return (len(np.unique(np.round(samples.command / LEVEL))), float(np.ptp(samples.command)),
            bool(rising))


def fit_map(samples: Samples, *, block: IntArray | None = None, square: FloatArray | None = None,
            understeer: tuple[float, float] = (0.0, 0.0), robust: bool = False) -> SteeringMap:
    """Weighted least squares, the covariance by leaving out one block after the other.

    block (n,): which samples share their errors, None = those of ``samples``.
    square (n,) v^2, understeer: K and its one sigma [s2/m2], which is carried
    into the covariance. robust: soft L1 beyond three times the scatter.
    """
    square = np.zeros(len(samples)) if square is None else square
    root, pull = np.sqrt(samples.weight), NOISE / PRIOR_STD
    bounds = (LOW.tolist(), HIGH.tolist())

    def model(x: FloatArray) -> curves.Curve:
        delta, slopes = curves.steering(x, samples.command)
        slip = understeer[0] * square
        seen = root * (delta - 0.5 * slip * np.sin(2.0 * delta))
        by_delta = root * (1.0 - slip * np.cos(2.0 * delta))
        return (np.concatenate([seen, pull * x]),
                np.concatenate([by_delta[:, None] * slopes, np.diag(pull)]))

    target = np.concatenate([root * samples.angle, pull * TYPICAL])
    found = fit_curve(model, target, TYPICAL.tolist(), bounds)
    if robust:
        beyond = SOFT_L1_STDS * max(scatter(found.residual), LEAST_SCATTER)
        found = fit_curve(model, target, found.x.tolist(), bounds, robust=beyond)
    label = np.unique(samples.block if block is None else block, return_inverse=True)[1]
    covariance = leverage_covariance(found, np.append(label, label.max() + 1 + np.arange(5)))
    delta = curves.steering(found.x, samples.command)[0]
    effect = np.append(-0.5 * root * square * np.sin(2.0 * delta), np.zeros(5))
    weighted = found.jacobian * found.weight[:, None]
    shift = np.linalg.pinv(weighted.T @ found.jacobian) @ (weighted.T @ effect) * understeer[1]
    return SteeringMap(found, np.asarray(covariance + np.outer(shift, shift)))
