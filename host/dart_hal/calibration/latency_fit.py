"""Least squares over repeated steps, with what was known of some parameters before.

What a model leaves of one step is one error, not a hundred: samples of one repetition hang
together. Where repetitions are told the covariance is the sandwich over them
(``fitting.covariance``), else every sample is by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.covariance import block_covariance, plain_covariance
from dart_hal.vehicle.fitting.least_squares import Solution, least_squares

Residual = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Problem:
    """residual(x) (m,) of parameters x (n,) between low and high, by ``steps`` (n,).

    known (n,): one sigma with which a parameter was known to be ``start``, inf = it was not.
    noise: of a residual. cluster (m,): to which repetition it belongs, None: they are independent.
    """

    residual: Residual
    start: FloatArray
    low: FloatArray
    high: FloatArray
    steps: FloatArray
    known: FloatArray
    noise: float
    cluster: IntArray | None = None


@dataclass(frozen=True, slots=True)
class Fit:
    """Parameters (n,), covariance (n, n), 0 for one that was held, and rms of what is left."""

    x: FloatArray
    covariance: FloatArray
    left: float

    @property
    def std(self) -> FloatArray:
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit(p: Problem, held: int | None = None) -> Fit:
    """The parameters; ``held``: one of them stays 0.

    What was known is fitted in units of its sigma, for which ``block_covariance`` has a prior.
    """
    free = np.arange(len(p.start)) != (-1 if held is None else held)
    of = np.isfinite(p.known)
    unit = np.where(of, p.known, p.steps)
    weight = np.where(of, p.noise, 0.0)[free]

    def x_of(z: FloatArray) -> FloatArray:
        x = np.where(free, p.start, 0.0)
        x[free] += z * unit[free]
        return x

    def residual(z: FloatArray) -> FloatArray:
        return np.concatenate([p.residual(x_of(z)), weight * z])

    def slopes(z: FloatArray) -> FloatArray:
        return np.column_stack([_slope(residual, z, k, step)
                                for k, step in enumerate((p.steps / unit)[free])])

    low, high = (((end - p.start) / unit)[free] for end in (p.low, p.high))
    found = least_squares(residual, [0.0] * len(weight), (low, high), jacobian=slopes,
                          tolerance=1e-8)
    rows = len(found.residual) - len(weight)
    data = Solution(found.x, found.residual[:rows], found.jacobian[:rows], found.weight[:rows],
                    found.converged, found.at_bound)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = np.outer(unit[free], unit[free]) * (
        plain_covariance(found) if p.cluster is None
        else block_covariance(data, p.cluster, weight**2))
    return Fit(x_of(found.x), covariance, data.rmse)


def fit_lag(p: Problem, lag: int, least: float) -> tuple[Fit, bool]:
    """(the parameters, whether the one of that index showed); below ``least`` it counts as 0."""
    found = fit(p)
    shows = bool(found.x[lag] >= least)
    return (found if shows else fit(p, held=lag)), shows


def _slope(residual: Residual, x: FloatArray, k: int, step: float) -> FloatArray:
    """d residual / d x[k] by central differences, also at a bound."""
    up, down = x.copy(), x.copy()
    up[k], down[k] = x[k] + step, x[k] - step
    return (residual(up) - residual(down)) / (2.0 * step)
