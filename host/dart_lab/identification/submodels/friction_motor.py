"""Fits "friction" and "motor" out of straight driving: coasting, then what is driven."""

from __future__ import annotations

import numpy as np

from dart_hal.vehicle import Vehicle
from dart_lab.identification.fit import Estimate, Fit
from dart_lab.identification.submodels.coasting import FRICTION
from dart_lab.identification.submodels.driving import MOTOR, TIMING, Driving
from dart_lab.identification.submodels.report import UNITS, not_identified
from dart_lab.identification.submodels.speeds import MAX_STEERING, MAX_YAW_RATE
from dart_lab.identification.submodels.straight import NAMES, Straight

INDEPENDENT = 0.02  # share of a parameter's effect that must be its own
# standard error over value of what counts as identified
MAX_RELATIVE = {"a": 0.3, "b": 0.5, "c": 0.5, "d": 0.3, "e": 0.5}
MAX_STD_G = 0.03  # of throttle


def estimate(fit: Straight, name: str, unit: str) -> Estimate:
    """One parameter; what was held is not identifiable and has no finite error."""
    value, std = fit.value(name), fit.std(name)
    if name not in fit.free:
        return Estimate(value, np.inf, unit, False)
    limit = MAX_STD_G if name == "g" else MAX_RELATIVE.get(name, np.inf) * max(abs(value), 1e-9)
    known = std < limit and fit.independent[NAMES.index(name)] > INDEPENDENT
    return Estimate(value, std, unit, bool(known))


def longitudinal_fit(submodel: str, d: Driving, base: Vehicle, mass: Estimate | None,
                     cpu_s: float) -> Fit:
    """``submodel`` "friction" or "motor" with its part of the covariance."""
    names = FRICTION if submodel == "friction" else MOTOR
    held = vars_of(base, submodel)
    if d.fit is None:
        return not_identified(submodel, held, [d.why_not], cpu_s)
    fit = d.coast if submodel == "friction" else d.fit
    missing = [n for n in names if fit is None or n not in fit.free]
    if fit is None or len(missing) == len(names):
        what = "coasting" if submodel == "friction" else "driven"
        return not_identified(submodel, held, [f"too little {what} motion"], cpu_s)
    rows = [NAMES.index(n) for n in names]
    covariance = fit.covariance[np.ix_(rows, rows)].copy()
    for i, name in enumerate(names):
        if name in missing:
            covariance[i, i] = np.inf
    values = {n: estimate(fit, n, UNITS[submodel][n]) for n in names}
    return Fit(submodel, values, covariance, len(fit.residual), fit.rmse, "m/s",
               fit.converged, fit.at_bound(names), cpu_s,
               tuple(_notes(submodel, d, fit, base, mass)), {"sessions": fit.sessions})


def vars_of(base: Vehicle, submodel: str) -> dict[str, float]:
    """The base's values of a sub-model by name."""
    group = getattr(base, submodel)
    return {name: float(getattr(group, name)) for name in UNITS[submodel]}


def _notes(submodel: str, d: Driving, fit: Straight, base: Vehicle, mass: Estimate | None
           ) -> list[str]:
    kilograms = base.body.mass if mass is None else mass.value
    out = [f"straight driving only (|yaw rate| < {MAX_YAW_RATE} rad/s, |steering| < "
           f"{MAX_STEERING}): {d.driven} driven and {d.coasting} coasting samples, "
           f"{d.slowest:.2f} to {d.fastest:.2f} m/s"]
    out.append(f"forces for a mass of {kilograms:g} kg"
               + (" taken as exact: they are known no better than the mass"
                  if mass is None or not mass.std else f" +- {mass.std:g} kg, part of the errors"))
    if submodel == "motor":
        if "a" not in fit.free:
            out.append("no coasting: friction held at the base's values")
        if "g" not in fit.free:
            out.append(f"throttle levels span {d.level_span:.3f}: d, e and g cannot be told "
                       "apart, g held at the base's value")
        if TIMING[0] in fit.free:
            out.append("fitted along, from the command itself: throttle delay "
                       f"{fit.value('throttle_s'):+.3f} +- {fit.std('throttle_s'):.3f} s, lag "
                       f"{fit.value('throttle_lag_s'):.3f} +- {fit.std('throttle_lag_s'):.3f} s")
    return [*out, *(d.coast_notes if submodel == "friction" else d.notes)]
