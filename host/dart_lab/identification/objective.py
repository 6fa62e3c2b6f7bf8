"""The objective of every fit, its minimisation, and the linear model around a minimum.

Objective over whitened residuals r (N,) with weights w (N,) and coordinates x (k,). R (k, k), the
precision of the prior (``Space.prior_precision``), is 1 for a parameter, in prior standard
deviations, and the inverse of the correlations where the file of the model states them; for the
timing it follows from its units, and is 0 where bounds alone limit it:

    J(x) = sum_i w_i rho(r_i(x)) + x^T R x                 low <= x <= high

Around a point, with Jacobian A (N, k) and Omega = diag(w_i / sqrt(1 + (r_i / c)^2)):

    H = A^T Omega A + R                                    normal matrix, "normal"
    d = -H^-1 (A^T Omega r + R x)                          step, within the bounds
    P v = v - A H^-1 A^T Omega v                           projection: v orthogonal to A
    C = H^-1 (sum_b g_b g_b^T + R) H^-1                    covariance, g_b = gradient of block b in
                                                           a fit without it; at least H^-1
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import enclosing_covariance, leverage_scores
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.fitting.levenberg_marquardt import (
    JACOBIAN_TOLERANCE,
    descend,
    solve_box_quadratic,
)
from dart_hal.vehicle.parameters import Vehicle

from .evidence.noise import Noise
from .evidence.residuals import Evidence
from .evidence.space import MessageTiming, Space

# Limits of Levenberg-Marquardt: with a new Jacobian, and with one that is not updated.
MAX_FIT_ITERATIONS = 15
MAX_REUSE_ITERATIONS = 6

RowSelection = slice | BoolArray
ALL_ROWS = slice(None)


class FittedModel(Protocol):
    """A fitted model: the vehicle, and the timing of the recordings that it was fitted to."""

    @property
    def vehicle(self) -> Vehicle: ...

    @property
    def timing(self) -> MessageTiming: ...


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Normal equations of some rows: weighted normal matrix (k, k), half gradient (k,)."""

    normal: FloatArray
    gradient: FloatArray

    def loss_change(self, move: FloatArray) -> float:
        """Predict the change of the loss for a step (k,) to second order, with constant weights."""
        return float(2.0 * self.gradient @ move + move @ self.normal @ move)


@dataclass(frozen=True, slots=True)
class Point:
    """Linear model at x (k,): whitened residuals (N,), their weights (N,), Jacobian (N, k)."""

    noise: Noise
    space: Space
    x: FloatArray
    residual: FloatArray
    weight: FloatArray
    jacobian: FloatArray

    @property
    def vehicle(self) -> Vehicle:
        return self.space.split(self.x)[0]

    @property
    def timing(self) -> MessageTiming:
        return self.space.split(self.x)[1]

    @property
    def irls_weight(self) -> FloatArray:
        """Weights (N,) of the equivalent least-squares problem (iteratively reweighted)."""
        return np.asarray(self.weight * self.noise.robust_weight(self.residual))

    @property
    def normal(self) -> FloatArray:
        """Normal matrix (k, k) of the equivalent least-squares problem, with the prior."""
        weighted = self.jacobian * self.irls_weight[:, None]
        return np.asarray(weighted.T @ self.jacobian + self.space.prior_precision
                          + 1e-6 * np.eye(len(self.x)))

    def loss(self) -> float:
        """Robust loss of the data, with the prior."""
        return float(self.weight @ self.noise.loss(self.residual)) + self.prior_loss(
            np.zeros(len(self.x)))

    def normal_equations(self, residual: FloatArray,
                         rows: RowSelection = ALL_ROWS) -> NormalEquations:
        """Compute the normal equations of some rows for other residuals (N,)."""
        jac = self.jacobian[rows]
        weight = self.weight[rows]
        r = residual[rows]
        root = np.sqrt(weight * self.noise.robust_weight(r))
        weighted = jac * root[:, None]  # a matrix by itself is half the work
        return NormalEquations(weighted.T @ weighted, weighted.T @ (root * r))

    def bounded_step(self, normal: FloatArray, gradient: FloatArray) -> FloatArray:
        """Solve the normal equations of all rows for a step (k,), with priors and bounds."""
        return solve_box_quadratic(
            normal + self.space.prior_precision + 1e-9 * np.eye(len(self.x)),
            gradient + self.space.prior_precision @ self.x, self.space.low - self.x,
            self.space.high - self.x)

    def best_step(self, residual: FloatArray, rows: RowSelection = ALL_ROWS) -> FloatArray:
        """Compute the step (k,) that minimises the loss of other residuals (N,) to first order."""
        equations = self.normal_equations(residual, rows)
        return self.bounded_step(equations.normal, equations.gradient)

    def residual_after_step(self, residual: FloatArray) -> FloatArray:
        """Other residuals (N,) after ``best_step``, to first order."""
        return np.asarray(residual + self.jacobian @ self.best_step(residual))

    def prior_loss(self, move: FloatArray) -> float:
        """Loss of the prior after a step (k,)."""
        x = self.x + move
        return float(x @ self.space.prior_precision @ x)

    def block_gradients(self, block: IntArray) -> FloatArray:
        """Half gradient of the loss of each block, (blocks, k); block (N,): label of each row."""
        out = np.zeros((int(block.max()) + 1, len(self.x)))
        np.add.at(out, block, self.jacobian * (self.irls_weight * self.residual)[:, None])
        return out

    def wald_statistic(self, names: Sequence[str]) -> float:
        """Predict the increase of the loss without some parameters, to second order."""
        indices = [self.space.names.index(n) for n in names]
        part = np.linalg.inv(self.normal)[np.ix_(indices, indices)]
        return float(self.x[indices] @ np.linalg.solve(part, self.x[indices]))

    def projection(self, fixed: Sequence[int] = ()) -> Callable[[FloatArray], FloatArray]:
        """Return the function that removes from directions (N,) or (N, d) the span of A.

        fixed: indices of coordinates that are not free.
        """
        free = np.setdiff1d(np.arange(len(self.x)), fixed)
        jacobian = self.jacobian[:, free]
        normal = self.normal[np.ix_(free, free)]
        to_parameters = np.linalg.solve(normal, (jacobian * self.irls_weight[:, None]).T)
        return lambda direction: np.asarray(direction - jacobian @ (to_parameters @ direction))


@dataclass(frozen=True, slots=True)
class StatedParameters:
    """Parameters that keep the values of the file, which are not exact.

    jacobian (N, q): of the residuals, per standard error; precision (q, q): of their errors.
    """

    jacobian: FloatArray
    precision: FloatArray


def evaluate_point(evidence: Evidence, noise: Noise, space: Space, x: FloatArray) -> Point:
    """Evaluate residuals and Jacobian of a space at x."""
    r, weight = _residual(evidence, noise, space, x)
    return Point(noise, space, x, r, weight, _jacobian(evidence, noise, space, x, r))


def change_noise(evidence: Evidence, noise: Noise, point: Point) -> Point:
    """Return a point whitened by another noise."""
    r, weight = _residual(evidence, noise, point.space, point.x)
    return Point(noise, point.space, point.x, r, weight,
                 _reuse_jacobian(evidence, noise, point.space, point.x, point))


def refit(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
          reference: Point | None = None, max_iterations: int = MAX_FIT_ITERATIONS,
          jobs: int = 1) -> Point:
    """Minimise the objective from x: Levenberg-Marquardt within bounds, soft L1 loss, priors.

    reference: a point whose Jacobian is used while steps reduce the loss as predicted.
    jobs: number of processes that compute the Jacobian.
    """
    first = None if reference is None else _reuse_jacobian(evidence, noise, space, x, reference)
    return _descend(evidence, noise, space, x, max_iterations, first, jobs=jobs)


def refit_extended(evidence: Evidence, noise: Noise, space: Space, x: FloatArray, reference: Point,
                   residual: FloatArray) -> Point:
    """Call ``refit_reusing_jacobian`` for a space that extends the space of the reference.

    residual (N,): at x, before the free coordinates are re-fitted.
    """
    shifted = space.transfer(x, reference.space, reference.x + reference.best_step(residual))
    # Start from x or from the first-order step, whichever has the smaller loss.
    x = min((np.clip(z, space.low, space.high) for z in (x, shifted)),
            key=lambda z: loss_at(evidence, noise, space, z))
    return refit_reusing_jacobian(evidence, noise, space, x, reference)


def refit_reusing_jacobian(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
                           reference: Point, max_iterations: int = MAX_REUSE_ITERATIONS) -> Point:
    """Minimise from x with the Jacobian of a reference; only its missing columns are computed."""
    return _descend(evidence, noise, space, x, max_iterations,
                    _reuse_jacobian(evidence, noise, space, x, reference), np.inf)


def _reuse_jacobian(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
                    reference: Point) -> FloatArray:
    """Jacobian (N, k) at x, with the columns that the reference has copied from it."""
    r = _residual(evidence, noise, space, x)[0]
    tail = len(reference.space.names)  # columns of timing come after the named ones
    reused = reference.jacobian
    # The columns are whitened: convert them if the noise differs.
    if noise is not reference.noise:
        reused = noise.rewhiten(reference.noise, reused, len(evidence.motion_drive))
    known = {name: reused[:, i] for i, name in enumerate(reference.space.names)}
    columns = [known[name] if name in known
               else _partial_derivative(evidence, noise, space, x, r, i)
               for i, name in enumerate(space.names)]
    return np.column_stack([*columns, reused[:, tail:]])


def _descend(evidence: Evidence, noise: Noise, space: Space, x: FloatArray, max_iterations: int,
             first: FloatArray | None = None, jacobian_tolerance: float = JACOBIAN_TOLERANCE,
             jobs: int = 1) -> Point:
    """Minimise the objective; first (N, k): initial Jacobian of the whitened residuals.

    jacobian_tolerance: see ``descend``.
    """
    weight = _residual(evidence, noise, space, x)[1]
    root = np.sqrt(weight)
    pull = space.prior_root

    # The prior is appended as k rows to the N weighted residuals.
    def residual(z: FloatArray) -> FloatArray:
        return np.concatenate([root * _residual(evidence, noise, space, z)[0], pull @ z])

    def weight_rows(matrix: FloatArray) -> FloatArray:
        return np.concatenate([root[:, None] * matrix, pull])

    def jacobian(z: FloatArray, r: FloatArray) -> FloatArray:
        return weight_rows(_jacobian(evidence, noise, space, z, r[:len(root)] / root, jobs))

    far = np.full(len(x), 1e6)  # no robust limit for the rows of the prior
    robust = np.concatenate([noise.policy.robust * root, far])
    found = descend(residual, jacobian, x, space.low, space.high, robust=robust, prior=1e-9,
                    max_iterations=max_iterations, max_step=space.max_step,
                    jacobian_tolerance=jacobian_tolerance, initial_jacobian=None
                    if first is None else weight_rows(first))
    n = len(root)
    return Point(noise, space, found.x, found.residual[:n] / root, weight,
                 found.jacobian[:n] / root[:, None])


def covariance(point: Point, block: IntArray) -> FloatArray:
    """Covariance (k, k) of a fitted point: sandwich over blocks (N,) of rows, with the prior.

    A fit of k parameters to few blocks makes the gradient of each block smaller than at the true
    parameters, so each is that of a fit without the block (``leverage_covariance``). The result is
    at least the covariance of independent residuals, in every direction: with few blocks the
    sandwich can be singular along one.
    """
    bread = np.asarray(np.linalg.inv(point.normal), dtype=np.float64)
    data = Solution(point.x, point.residual, point.jacobian, point.irls_weight, True,
                    np.zeros(len(point.x), dtype=np.bool_))
    scores = leverage_scores(data, block, bread)
    meat = scores + point.space.prior_precision
    return enclosing_covariance(bread, bread @ meat @ bread)


def _residual(evidence: Evidence, noise: Noise, space: Space,
              x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals (N,) and weights (N,) at x, clipped to the bounds."""
    vehicle, timing = space.split(np.clip(x, space.low, space.high))
    return noise.stack(evidence.residuals(vehicle, timing))


def loss_at(evidence: Evidence, noise: Noise, space: Space, x: FloatArray) -> float:
    """Robust loss of the data at x, with the prior."""
    r, weight = _residual(evidence, noise, space, x)
    return float(weight @ noise.loss(r)) + float(x @ space.prior_precision @ x)


def _jacobian(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
              r: FloatArray, jobs: int = 1) -> FloatArray:
    """Jacobian (N, k) at x, one column per task; r (N,): residuals at x."""
    column = partial(_numbered_column, evidence, noise, space, x, r)
    # One packet per process: its columns share the cached parts of the rollouts.
    found = dict(map(column, range(len(x))) if jobs == 1 else
                 each(column, range(len(x)), jobs, parts=jobs))
    return np.stack([found[i] for i in range(len(x))], axis=1)


def _numbered_column(evidence: Evidence, noise: Noise, space: Space, x: FloatArray, r: FloatArray,
                     i: int) -> tuple[int, FloatArray]:
    """Column of the Jacobian with its index, for ``each``."""
    return i, _partial_derivative(evidence, noise, space, x, r, i)


def _partial_derivative(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
                        r: FloatArray, i: int) -> FloatArray:
    """Differentiate the residuals along coordinate i, (N,); r (N,): residuals at x."""
    # Central difference, or one-sided at a bound.
    up, down = space.steps(x)[i]
    step = np.zeros(len(x))
    if up + down == 0.0:
        return np.zeros(len(r))
    step[i] = 1.0
    above = _residual(evidence, noise, space, x + up * step)[0] if up else r
    below = _residual(evidence, noise, space, x - down * step)[0] if down else r
    return np.asarray((above - below) / (up + down))
