"""Fits "friction" and "motor" out of straight driving: coasting, then what is driven."""

from __future__ import annotations

import numpy as np

from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.submodels.coasting import FRICTION_NAMES
from dart_lab.identification.submodels.driving import (
    MOTOR_NAMES,
    TIMING_NAMES,
    UNKNOWN_FRICTION_SHARE,
    StraightDriving,
)
from dart_lab.identification.submodels.motor_fit import UNKNOWN_DEAD_BAND_STD
from dart_lab.identification.submodels.report import PARAMETER_UNITS, make_unidentified
from dart_lab.identification.submodels.speeds import MAX_STEERING, MAX_YAW_RATE
from dart_lab.identification.submodels.straight import STRAIGHT_NAMES, StraightFit

# Least share of a parameter's effect that no other parameter can have.
MIN_INDEPENDENT_EFFECT = 0.02
# Largest standard error over value of an identified parameter.
MAX_FORCE_RELATIVE_STD = {"a": 0.3, "b": 0.5, "c": 0.5, "d": 0.3, "e": 0.5}
# Largest standard error of the dead band [throttle]; its value may be 0.
MAX_STD_G = 0.03


def make_estimate(fit: StraightFit, name: str, unit: str) -> FittedParameter:
    """Make the estimate of one parameter; a fixed one is not identifiable, its error infinite."""
    value = fit.value(name)
    std = fit.std(name)
    if name not in fit.free:
        return FittedParameter(value, np.inf, unit, False)
    relative = MAX_FORCE_RELATIVE_STD.get(name, np.inf)
    limit = MAX_STD_G if name == "g" else relative * max(abs(value), 1e-9)
    known = std < limit and fit.independent[STRAIGHT_NAMES.index(name)] > MIN_INDEPENDENT_EFFECT
    return FittedParameter(value, std, unit, bool(known))


def make_longitudinal_fit(submodel: str, d: StraightDriving, base: Vehicle, mass: FittedParameter
                          | None, cpu_s: float) -> SubmodelFit:
    """Make the fit "friction" or "motor" with its part of the covariance."""
    names = FRICTION_NAMES if submodel == "friction" else MOTOR_NAMES
    values = base_values(base, submodel)
    if d.fit is None:
        return make_unidentified(submodel, values, [d.why_not], cpu_s)
    fit = d.coast if submodel == "friction" else d.fit
    missing = [n for n in names if fit is None or n not in fit.free]
    if fit is None or len(missing) == len(names):
        what = "coasting" if submodel == "friction" else "driven"
        return make_unidentified(submodel, values, [f"too little {what} motion"], cpu_s)
    rows = [STRAIGHT_NAMES.index(n) for n in names]
    covariance = fit.covariance[np.ix_(rows, rows)].copy()
    for i, name in enumerate(names):
        if name in missing:
            covariance[i, :] = covariance[:, i] = 0.0
            covariance[i, i] = np.inf
    estimates = {n: make_estimate(fit, n, PARAMETER_UNITS[submodel][n]) for n in names}
    return SubmodelFit(submodel, estimates, covariance, len(fit.residual), fit.rmse, "m/s",
                       fit.converged, fit.at_bound(names), cpu_s,
                       tuple(_notes(submodel, d, fit, base, mass)), {"sessions": fit.sessions})


def base_values(base: Vehicle, submodel: str) -> dict[str, float]:
    """Return the base's values of a sub-model by name."""
    group = getattr(base, submodel)
    return {name: float(getattr(group, name)) for name in PARAMETER_UNITS[submodel]}


def _notes(submodel: str, d: StraightDriving, fit: StraightFit, base: Vehicle,
           mass: FittedParameter | None
           ) -> list[str]:
    kilograms = base.body.mass if mass is None else mass.value
    turning = MAX_YAW_RATE * find_scale(base.body).yaw_rate
    out = [f"straight driving only (|yaw rate| < {turning:.2g} rad/s, |steering| < "
           f"{MAX_STEERING}): {d.driven} driven and {d.coasting} coasting samples, "
           f"{d.slowest:.2f} to {d.fastest:.2f} m/s"]
    out.append(f"forces for a mass of {kilograms:g} kg"
               + (" taken as exact: they are known no better than the mass"
                  if mass is None or not mass.std else f" +- {mass.std:g} kg, part of the errors"))
    if submodel == "motor":
        if "a" not in fit.free:
            out.append("no coasting: friction held at the base's values; errors of "
                       f"{100.0 * UNKNOWN_FRICTION_SHARE:g} % of these are part of the motor's")
        if "g" not in fit.free:
            out.append(f"throttle levels span {d.level_span:.3f}: d, e and g cannot be "
                       f"separated, g held at the base's value +- {UNKNOWN_DEAD_BAND_STD:g}, "
                       "part of the errors")
        if TIMING_NAMES[0] in fit.free:
            out.append("fitted together with it, from the command itself: throttle delay "
                       f"{fit.value('throttle_s'):+.3f} +- {fit.std('throttle_s'):.3f} s, lag "
                       f"{fit.value('throttle_lag_s'):.3f} +- {fit.std('throttle_lag_s'):.3f} s")
    return [*out, *(d.coast_notes if submodel == "friction" else d.notes)]
