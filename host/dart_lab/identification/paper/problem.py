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
from dart_lab.identification.fit import FittedParameter, SubmodelFit

from .folders import MIN_FOLDER_ROWS, make_too_few_error

# Largest standard error over value of an identified parameter.
MAX_RELATIVE_STD = 0.5
# Samples for a first guess.
MAX_GUESS_SAMPLES = 300
# Relative change of the loss: parameters are then exact to 1/1000 of their standard error.
LOSS_TOLERANCE = 1e-8


@dataclass(frozen=True, slots=True)
class CurveProblem:
    """Least-squares problem target (n,) = curve(x, *inputs) + residual, x (k,) in [low, high].

    unit: of the target; names, units (k,): as in ``model.toml``; paper (k,): values of the
    paper's code, None if it has no such sub-model; grid: candidates of the nonlinear parameters,
    by position (the others are amplitudes); needs: which rows count, in words.
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
        """Return model minus data, (n,)."""
        return np.asarray(self.curve(x, *self.inputs)[0] - self.target)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return d residual / d x, (n, k)."""
        return np.asarray(self.curve(x, *self.inputs)[1])

    def rmse(self, x: FloatArray) -> float:
        """Return the root mean square of the residuals at x."""
        return float(np.sqrt(np.mean(self.residual(x)**2)))

    @property
    def paper_rmse(self) -> float | None:
        """Root mean square of the residuals with the paper's values."""
        return None if self.paper is None else self.rmse(np.array(self.paper))


def thin(p: CurveProblem) -> CurveProblem:
    """Keep about MAX_GUESS_SAMPLES samples at equal distances."""
    every = max(1, len(p.target) // MAX_GUESS_SAMPLES)
    return replace(p, inputs=tuple(v[::every] for v in p.inputs), target=p.target[::every])


def first_guess(p: CurveProblem) -> FloatArray:
    """Find start values (k,): a grid of nonlinear parameters, amplitudes by linear regression.

    At given values of the others a curve is linear in its amplitudes, so its Jacobian is the
    matrix of the regression.
    """
    inputs = p.inputs
    target = p.target
    low, high = np.array(p.low), np.array(p.high)
    middle = 0.5 * (low + high)
    linear = [i for i in range(len(middle)) if i not in p.grid]
    best = middle
    least = np.inf
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
            best = x
            least = cost
    return np.asarray(best)


def solve(p: CurveProblem) -> SubmodelFit:
    """Solve by plain least squares; errors for independent residuals, as in the paper.

    Raises RecordingError with fewer than MIN_FOLDER_ROWS rows that count.
    """
    if len(p.target) < MIN_FOLDER_ROWS:
        raise make_too_few_error(p.submodel, p.needs, len(p.target))
    start = time.process_time()
    solution = fit_curve(lambda x: p.curve(x, *p.inputs), p.target,
                         first_guess(thin(p)).tolist(), (p.low, p.high), tolerance=LOSS_TOLERANCE)
    return as_fit(p, solution, time.process_time() - start)


def as_fit(p: CurveProblem, s: Solution, cpu_s: float) -> SubmodelFit:
    """Return the solution as a fit with standard errors.

    A parameter on which the residuals do not depend, alone or in a combination, has an infinite
    error, and the fit counts as not converged.
    """
    covariance = plain_covariance(s)
    lost_ones = find_undetermined(s)
    std = np.sqrt(np.diag(covariance))
    edge = tuple(n for n, stopped in zip(p.names, s.at_bound, strict=True) if stopped)
    parameters = {
        name: FittedParameter(float(value), float(error), unit,
                              bool(name not in edge and error < MAX_RELATIVE_STD * abs(value)))
        for name, value, error, unit in zip(p.names, s.x, std, p.units, strict=True)}
    lost = [name for name, no in zip(p.names, lost_ones, strict=True) if no]
    notes = p.notes + ((f"{', '.join(lost)}: not identifiable from these rows",) if lost else ())
    return SubmodelFit(p.submodel, parameters, covariance, len(p.target), s.rmse, p.unit,
                       s.converged and not lost, edge, cpu_s, notes)
