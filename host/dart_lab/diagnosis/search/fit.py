"""The best point of a space on some evidence, and what moves how around it.

The objective of every fit, over whitened residuals r (N,) with weights w (N,) and coordinates
x (k,) in prior standard deviations with p (k,) = 1 where a prior stands, else 0:

    J(x) = sum_i w_i rho(r_i(x)) + sum_k p_k x_k^2         low <= x <= high

Around a point, with Jacobian A (N, k) and Omega = diag(w_i / sqrt(1 + (r_i / c)^2)):

    H = A^T Omega A + diag(p)                              normal matrix, "normal"
    d = -H^-1 (A^T Omega r + diag(p) x)                    step, within the bounds
    P v = v - A H^-1 A^T Omega v                           projection: what is left of v
    C = H^-1 (sum_b g_b g_b^T + diag(p)) H^-1              covariance, g_b = score of block b
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.levenberg_marquardt import KEPT, bounded, descend
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.noise import Noise
from ..evidence.residuals import Evidence
from ..evidence.space import MessageTiming, Space

ROUNDS, QUICK = 15, 6


Part = slice | BoolArray
ALL = slice(None)


class Fit(Protocol):
    """What predicts: a vehicle, and the timing of the recordings that it was fitted to."""

    @property
    def vehicle(self) -> Vehicle: ...

    @property
    def timing(self) -> MessageTiming: ...


@dataclass(frozen=True, slots=True)
class Sums:
    """Of rows: weighted normal matrix (k, k), slope (k,)."""

    normal: FloatArray
    slope: FloatArray

    def rise(self, move: FloatArray) -> float:
        """Of the loss by a move (k,), from above: to second order, with the weights it has."""
        return float(2.0 * self.slope @ move + move @ self.normal @ move)


@dataclass(frozen=True, slots=True)
class Point:
    """Where a space is: whitened residuals (N,), their weight (N,), and the Jacobian (N, k)."""

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
        """(N,) of the equivalent least squares."""
        return np.asarray(self.weight * self.noise.robust_weight(self.residual))

    @property
    def normal(self) -> FloatArray:
        """(k, k) matrix of the equivalent least squares, with the prior."""
        weighted = self.jacobian * self.irls_weight[:, None]
        return np.asarray(weighted.T @ self.jacobian + np.diag(self.space.prior_weight + 1e-6))

    def loss(self) -> float:
        """Robust loss of the data with the prior."""
        return float(self.weight @ self.noise.loss(self.residual)) + self.prior(
            np.zeros(len(self.x)))

    def sums(self, residual: FloatArray, rows: Part = ALL) -> Sums:
        """What some rows of other residuals (N,) say about a move."""
        jac, weight, r = self.jacobian[rows], self.weight[rows], residual[rows]
        root = np.sqrt(weight * self.noise.robust_weight(r))
        weighted = jac * root[:, None]  # a matrix by itself is half the work
        return Sums(weighted.T @ weighted, weighted.T @ (root * r))

    def step(self, normal: FloatArray, slope: FloatArray) -> FloatArray:
        """Move (k,) of all that is free, by sums over all rows; within bounds and priors."""
        return bounded(normal + np.diag(self.space.prior_weight + 1e-9),
                       slope + self.space.prior_weight * self.x,
                       self.space.low - self.x, self.space.high - self.x)

    def follow(self, residual: FloatArray, rows: Part = ALL) -> FloatArray:
        """Move (k,) of all that is free which suits other residuals (N,) best, to first order."""
        sums = self.sums(residual, rows)
        return self.step(sums.normal, sums.slope)

    def after(self, residual: FloatArray) -> FloatArray:
        """Other residuals (N,) once all that is free has followed."""
        return np.asarray(residual + self.jacobian @ self.follow(residual))

    def prior(self, move: FloatArray) -> float:
        """Loss of the prior after a move (k,)."""
        x = self.x + move
        return float((self.space.prior_weight * x) @ x)

    def scores(self, block: IntArray) -> FloatArray:
        """(blocks, k): slope of the loss of each block (N,) of rows."""
        out = np.zeros((int(block.max()) + 1, len(self.x)))
        np.add.at(out, block, self.jacobian * (self.irls_weight * self.residual)[:, None])
        return out

    def wald(self, names: Sequence[str]) -> float:
        """How much the loss would rise, to second order, without some of the parameters."""
        at = [self.space.names.index(n) for n in names]
        part = np.linalg.inv(self.normal)[np.ix_(at, at)]
        return float(self.x[at] @ np.linalg.solve(part, self.x[at]))

    def projection(self, held: Sequence[int] = ()) -> Callable[[FloatArray], FloatArray]:
        """What is left of directions (N,) or (N, d) when all that is free may follow them.

        held: coordinates that do not.
        """
        free = np.setdiff1d(np.arange(len(self.x)), held)
        jacobian, normal = self.jacobian[:, free], self.normal[np.ix_(free, free)]
        back = np.linalg.solve(normal, (jacobian * self.irls_weight[:, None]).T)
        return lambda direction: np.asarray(direction - jacobian @ (back @ direction))


def at(evidence: Evidence, noise: Noise, space: Space, x: FloatArray) -> Point:
    """The space at a point, with its Jacobian."""
    r, weight = _residual(evidence, noise, space, x)
    return Point(noise, space, x, r, weight, _jacobian(evidence, noise, space, x, r))


def seen_by(evidence: Evidence, noise: Noise, point: Point) -> Point:
    """A point with another noise."""
    r, weight = _residual(evidence, noise, point.space, point.x)
    return Point(noise, point.space, point.x, r, weight,
                 _slopes_of(evidence, noise, point.space, point.x, point))


def refit(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
          near: Point | None = None, rounds: int = ROUNDS, jobs: int = 1) -> Point:
    """The best point from x on: Levenberg-Marquardt within bounds, soft L1, priors.

    near: a point whose slopes are used as long as steps gain what they promise. jobs:
    processes that find slopes.
    """
    first = None if near is None else _slopes_of(evidence, noise, space, x, near)
    return _descend(evidence, noise, space, x, rounds, first, jobs=jobs)


def refit_with(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
               near: Point, residual: FloatArray) -> Point:
    """``refit_near`` for a space with more in it than that of the point nearby.

    residual (N,): at x, before what is free has followed.
    """
    moved_along = space.transfer(x, near.space, near.x + near.follow(residual))
    x = min((np.clip(z, space.low, space.high) for z in (x, moved_along)),
            key=lambda z: loss_at(evidence, noise, space, z))
    return refit_near(evidence, noise, space, x, near)


def refit_near(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
               near: Point) -> Point:
    """The same with the slopes of a point nearby alone; only those that it lacks are found."""
    return _descend(evidence, noise, space, x, QUICK,
                    _slopes_of(evidence, noise, space, x, near), np.inf)


def _slopes_of(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
               near: Point) -> FloatArray:
    """(N, k) at x, those that a point nearby has from there."""
    r, tail = _residual(evidence, noise, space, x)[0], len(near.space.names)
    slopes = near.jacobian
    if noise is not near.noise:
        slopes = noise.rewhiten(near.noise, slopes, len(evidence.motion_drive))
    known = {name: slopes[:, i] for i, name in enumerate(near.space.names)}
    columns = [known[name] if name in known else _slope(evidence, noise, space, x, r, i)
               for i, name in enumerate(space.names)]
    return np.column_stack([*columns, slopes[:, tail:]])


def _descend(evidence: Evidence, noise: Noise, space: Space, x: FloatArray, rounds: int,
             first: FloatArray | None = None, kept: float = KEPT, jobs: int = 1) -> Point:
    """first (N, k): Jacobian of the whitened residuals to begin with; kept: see ``descend``."""
    weight = _residual(evidence, noise, space, x)[1]
    root, pull = np.sqrt(weight), np.sqrt(space.prior_weight)

    def residual(z: FloatArray) -> FloatArray:
        return np.concatenate([root * _residual(evidence, noise, space, z)[0], pull * z])

    def weighted(slopes: FloatArray) -> FloatArray:
        return np.concatenate([root[:, None] * slopes, np.diag(pull)])

    def jacobian(z: FloatArray, r: FloatArray) -> FloatArray:
        return weighted(_jacobian(evidence, noise, space, z, r[:len(root)] / root, jobs))

    far = np.full(len(x), 1e6)  # the prior is quadratic however far
    robust = np.concatenate([noise.policy.robust * root, far])
    found = descend(residual, jacobian, x, space.low, space.high,
                    robust=robust, prior=1e-9, rounds=rounds, reach=space.max_step, kept=kept,
                    first=None if first is None else weighted(first))
    n = len(root)
    return Point(noise, space, found.x, found.residual[:n] / root, weight,
                 found.jacobian[:n] / root[:, None])


def covariance(point: Point, block: IntArray) -> FloatArray:
    """Of a fitted point (k, k): sandwich over blocks (N,) of rows, prior included."""
    bread = np.linalg.inv(point.normal)
    scores = point.scores(block)
    sandwich = bread @ (scores.T @ scores + np.diag(point.space.prior_weight)) @ bread
    # with few blocks the sandwich may miss a direction: never less than half of the model's own
    return np.asarray(np.maximum(sandwich, 0.5 * bread) * np.eye(len(bread))
                      + sandwich * (1.0 - np.eye(len(bread))))


def _residual(evidence: Evidence, noise: Noise, space: Space,
              x: FloatArray) -> tuple[FloatArray, FloatArray]:
    vehicle, timing = space.split(np.clip(x, space.low, space.high))
    return noise.stack(evidence.residuals(vehicle, timing))


def loss_at(evidence: Evidence, noise: Noise, space: Space, x: FloatArray) -> float:
    """Robust loss of the data with the prior, at x."""
    r, weight = _residual(evidence, noise, space, x)
    return float(weight @ noise.loss(r)) + float((space.prior_weight * x) @ x)


def _jacobian(evidence: Evidence, noise: Noise, space: Space, x: FloatArray,
              r: FloatArray, jobs: int = 1) -> FloatArray:
    column = partial(_column, evidence, noise, space, x, r)
    # a packet for each process: they share what no slope changes
    found = dict(map(column, range(len(x))) if jobs == 1 else
                 each(column, range(len(x)), jobs, parts=jobs))
    return np.stack([found[i] for i in range(len(x))], axis=1)


def _column(evidence: Evidence, noise: Noise, space: Space, x: FloatArray, r: FloatArray,
            i: int) -> tuple[int, FloatArray]:
    return i, _slope(evidence, noise, space, x, r, i)


def _slope(evidence: Evidence, noise: Noise, space: Space, x: FloatArray, r: FloatArray,
           i: int) -> FloatArray:
    """Derivative (N,) of the residuals along coordinate i; r (N,): the residuals at x."""
    (up, down), step = space.steps(x)[i], np.zeros(len(x))
    if up + down == 0.0:
        return np.zeros(len(r))
    step[i] = 1.0
    above = _residual(evidence, noise, space, x + up * step)[0] if up else r
    below = _residual(evidence, noise, space, x - down * step)[0] if down else r
    return np.asarray((above - below) / (up + down))
