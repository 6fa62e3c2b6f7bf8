"""The Levenberg-Marquardt of the joint fit and scipy's solver, on the committed recordings.

    python benchmarks/bench_solver.py

Both minimise the same robust loss with the same priors, bounds, residuals and
Jacobians; what counts is how often a car has to be driven through the windows.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np
from bench_identify import EXCERPT
from figures import Figure
from scipy.optimize import least_squares

from dart_hal.car.runs import read_any
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.fitting.least_squares import Solution, at_bound
from dart_hal.vehicle.fitting.robust import soft_l1_weight
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.shooting import JointFit, ShootingProblem, fit, fit_from_recordings

FOLDERS = ("60*", "circles*")
COST_TOLERANCE = 1e-4  # relative, as in the joint fit


def by_scipy(residual: Callable[[FloatArray], FloatArray],
             jacobian: Callable[[FloatArray, FloatArray], FloatArray], x: FloatArray,
             low: FloatArray, high: FloatArray, *, robust: float, prior: float) -> Solution:
    """Minimise as ``descend`` does, by the trust region reflective solver."""
    # A prior w |x|^2 is one more row of residuals, sqrt(w) x, for each parameter.
    pull = np.sqrt(prior)
    last: dict[bytes, FloatArray] = {}

    def cached_residual(z: FloatArray) -> FloatArray:
        if z.tobytes() not in last:
            last.clear()
            last[z.tobytes()] = residual(z)
        return last[z.tobytes()]

    def loss(z: FloatArray) -> FloatArray:  # soft L1 for the data, the square for the prior
        root = np.sqrt(1.0 + z)
        rho = np.stack([2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3])
        rho[:, -len(x):] = z[-len(x):], np.ones(len(x)), np.zeros(len(x))
        return rho

    found = least_squares(
        lambda z: np.append(cached_residual(z), pull * z), np.clip(x, low + 1e-9, high - 1e-9),
        jac=lambda z: np.concatenate([jacobian(z, cached_residual(z)), pull * np.eye(len(z))]),
        bounds=(low, high), loss=loss, f_scale=robust, ftol=COST_TOLERANCE, xtol=COST_TOLERANCE)
    r = residual(found.x)
    return Solution(found.x, r, jacobian(found.x, r), soft_l1_weight(r, robust),
                    bool(found.status > 0), at_bound(found.x, low, high))


def measure(solver: Callable[..., Solution]) -> tuple[JointFit, int, float]:
    """(fit, rollouts of all windows, CPU time [s]) of one joint fit."""
    recordings = read_any([p for name in FOLDERS for p in sorted(EXCERPT.glob(name))])[0]
    predict, count = ShootingProblem.predict, 0

    def predict_and_count(self: ShootingProblem, *given: Any) -> FloatArray:
        nonlocal count
        count += 1
        return predict(self, *given)

    with (patch.object(fit, "descend", solver),
          patch.object(ShootingProblem, "predict", predict_and_count)):
        begin = time.process_time()
        made = fit_from_recordings(recordings, PAPER)[0]
        return made, count, time.process_time() - begin


def figures(scale: float = 1.0) -> list[Figure]:
    """Rollouts of both, with what they reach."""
    if scale < 1.0:
        return []
    out = []
    for name, solver in (("own", fit.descend), ("scipy's", by_scipy)):
        made, rollouts, cpu = measure(solver)
        reached = ", ".join(f"{v:.3f}" for v in made.after)
        out.append(Figure(f"joint fit, {name} solver", rollouts, "rollouts",
                          note=f"CPU {cpu:.1f} s; rms after {reached}"))
    return out


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.name:40} {figure.measured:>12}  {figure.note}")
