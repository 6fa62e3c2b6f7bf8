"""One sub-model as a least-squares problem, and its solution as a ``Fit``."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from dart_hal.calibration.curves import Curve
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.fitting.covariance import find_undetermined, plain_covariance
from dart_hal.vehicle.fitting.least_squares import Solution, fit_curve
from dart_lab.identification.fit import Estimate, Fit

from .folders import LEAST_ROWS, too_few

DOUBT = 0.5
"""A standard error above this share of the value: the data do not tell it."""
THIN = 300
"""Samples that are enough to find a first guess."""
TOLERANCE = 1e-8
"""Of the loss: parameters are then exact to a thousandth of their standard error."""


@dataclass(frozen=True, slots=True)
class CurveProblem:
    """target (n,) in ``unit`` = curve(x, *inputs) + residual, x (k,) in [low, high].

    names and units (k,) as in ``model.toml``; paper (k,): the values of the
    paper's code, None where it has no such sub-model. grid: candidates of the
    parameters that do not enter linearly, by position; amplitudes are the
    rest. needs: the rows that count, in words.
    """

    submodel: str
    curve: Callable[..., Curve]
    inputs: tuple[FloatArray, ...]
    target: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    unit: str
    grid: Mapping[int, tuple[float, ...]]
    paper: tuple[float, ...] | None = None
    notes: tuple[str, ...] = field(default=())
    needs: str = "rows"

    def residual(self, x: FloatArray) -> FloatArray:
        """Model minus data, (n,)."""
        return np.asarray(self.curve(x, *self.inputs)[0] - self.target)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """d residual / d x, (n, k)."""
        return np.asarray(self.curve(x, *self.inputs)[1])

    def rmse(self, x: FloatArray) -> float:
        """Root mean square of the residuals at x."""
        return float(np.sqrt(np.mean(self.residual(x)**2)))

    @property
    def paper_rmse(self) -> float | None:
        """Root mean square of the residuals with the paper's values."""
        return None if self.paper is None else self.rmse(np.array(self.paper))


def thinned(p: CurveProblem) -> CurveProblem:
    """Every so manieth sample, about THIN of them."""
    every = max(1, len(p.target) // THIN)
    return replace(p, inputs=tuple(v[::every] for v in p.inputs), target=p.target[::every])


def first_guess(p: CurveProblem) -> FloatArray:
    """Start values (k,) out of the data: a coarse grid, amplitudes by linear least squares.

    At given values of the others a curve is linear in its amplitudes, so that
    its Jacobian there is all that the best amplitudes need.
    """
    inputs, target = p.inputs, p.target
    low, high = np.array(p.low), np.array(p.high)
    middle = 0.5 * (low + high)
    linear = [i for i in range(len(middle)) if i not in p.grid]
    best, least = middle, np.inf
    for values in product(*p.grid.values()):
        x = middle.copy()
        x[list(p.grid)] = values
        value, slopes = p.curve(x, *inputs)
        columns = slopes[:, linear]
        rest = target - value + columns @ x[linear]
        x[linear] = np.linalg.lstsq(columns, rest, rcond=None)[0]
        x = np.clip(x, low, high)
        cost = float(np.mean((p.curve(x, *inputs)[0] - target)**2))
        if cost < least:
            best, least = x, cost
    return np.asarray(best)


def solve(p: CurveProblem) -> Fit:
    """Plain least squares; errors as if the residuals were independent, as in the paper.

    Errors: RecordingError with less than LEAST_ROWS rows that count.
    """
    if len(p.target) < LEAST_ROWS:
        raise too_few(p.submodel, p.needs, len(p.target))
    start = time.process_time()
    solution = fit_curve(lambda x: p.curve(x, *p.inputs), p.target,
                         first_guess(thinned(p)).tolist(), (p.low, p.high), tolerance=TOLERANCE)
    return as_fit(p, solution, time.process_time() - start)


def as_fit(p: CurveProblem, s: Solution, cpu_s: float) -> Fit:
    """The result with its standard errors and what they are worth.

    A parameter on which the residuals do not depend, alone or together with
    others, has an infinite error, and the fit counts as not converged.
    """
    covariance, lost_ones = plain_covariance(s), find_undetermined(s)
    std = np.sqrt(np.diag(covariance))
    edge = tuple(n for n, stopped in zip(p.names, s.at_bound, strict=True) if stopped)
    parameters = {
        name: Estimate(float(value), float(error), unit,
                       bool(name not in edge and error < DOUBT * abs(value)))
        for name, value, error, unit in zip(p.names, s.x, std, p.units, strict=True)}
    lost = [name for name, no in zip(p.names, lost_ones, strict=True) if no]
    notes = p.notes + ((f"{', '.join(lost)}: these rows do not tell",) if lost else ())
    return Fit(p.submodel, parameters, covariance, len(p.target), s.rmse, p.unit,
               s.converged and not lost, edge, cpu_s, notes)
