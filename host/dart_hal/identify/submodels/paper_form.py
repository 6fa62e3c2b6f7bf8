"""Least squares for the paper's five-parameter steering map, with cluster-robust errors.

delta(s) = W A_L tanh(k_L (s + s0)) + (1 - W) A_R tanh(k_R (s + s0)). A weak
prior around a typical 1:10 car keeps a side that the data do not reach finite;
it weighs as much as one sample.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from dart_hal.identify.submodels.samples import Samples
from dart_hal.types import FloatArray
from dart_hal.vehicle.parameters import Steering
from dart_hal.vehicle.steering import make_steering

LOW = np.array([0.1, 0.1, -0.4, 0.1, 0.1])
HIGH = np.array([5.0, 1.2, 0.4, 1.2, 5.0])
TYPICAL = np.array([1.5, 0.35, 0.0, 0.40, 1.5])
PRIOR_STD = np.array([2.0, 0.5, 0.5, 0.5, 2.0])
NOISE = 0.02  # rad; the scale at which the prior weighs as much as one sample
STEP = np.array([1e-5, 1e-6, 1e-6, 1e-6, 1e-5])


@dataclass(frozen=True, slots=True)
class PaperFit:
    """parameters (5,): k_left, a_left_rad, s0, a_right_rad, k_right; covariance (5, 5)."""

    parameters: FloatArray
    covariance: FloatArray

    @property
    def steering(self) -> Steering:
        k_left, a_left, s0, a_right, k_right = map(float, self.parameters)
        return Steering(k_left, a_left, s0, a_right, k_right)

    def angle(self, command: FloatArray) -> FloatArray:
        """Road-wheel angle [rad] at command (n,)."""
        return curve(self.parameters, command)

    def std(self, command: FloatArray) -> FloatArray:
        """One sigma (n,) of ``angle`` [rad] if the form is right."""
        jac = jacobian(self.parameters, command)
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", jac, self.covariance, jac)))

    def as_dict(self) -> dict[str, float]:
        return asdict(self.steering)


def curve(p: FloatArray, command: FloatArray) -> FloatArray:
    """The form with parameters p (5,) at command (n,) [rad]."""
    k_left, a_left, s0, a_right, k_right = p.tolist()
    return np.asarray(make_steering(Steering(k_left, a_left, s0, a_right, k_right), np)(command))


def jacobian(p: FloatArray, command: FloatArray) -> FloatArray:
    """d angle / d parameter, (n, 5), central differences."""
    columns = []
    for i in range(5):
        step = np.zeros(5)
        step[i] = STEP[i]
        columns.append((curve(p + step, command) - curve(p - step, command)) / (2.0 * STEP[i]))
    return np.stack(columns, axis=1)


def fit(samples: Samples) -> PaperFit:
    """Weighted least squares; covariance by the jackknife over blocks.

    The jackknife (each block left out once) needs no independent samples
    within a block and does not shrink when a few blocks carry the fit.
    """
    from scipy.optimize import least_squares

    root = np.sqrt(samples.weight)

    def residual(p: FloatArray) -> FloatArray:
        data = root * (curve(p, samples.command) - samples.angle) / NOISE
        return np.concatenate([data, (p - TYPICAL) / PRIOR_STD])

    def slope(p: FloatArray) -> FloatArray:
        data = root[:, None] * jacobian(p, samples.command) / NOISE
        return np.concatenate([data, np.diag(1.0 / PRIOR_STD)])

    p = least_squares(residual, TYPICAL, jac=slope, bounds=(LOW, HIGH), x_scale=PRIOR_STD,
                      xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    return PaperFit(p, _jackknife(p, samples))


def _jackknife(p: FloatArray, samples: Samples) -> FloatArray:
    jac = jacobian(p, samples.command) / NOISE
    error = (samples.angle - curve(p, samples.command)) / NOISE
    weighted = jac * samples.weight[:, None]
    total = weighted.T @ jac + np.diag(PRIOR_STD**-2)
    groups = np.unique(samples.block)
    shifts = []
    for group in groups:
        rows = samples.block == group
        rest = total - weighted[rows].T @ jac[rows]
        shifts.append(np.linalg.solve(rest, -(weighted[rows].T @ error[rows])))
    spread = np.array(shifts)
    return np.asarray((len(groups) - 1) / len(groups) * spread.T @ spread)
