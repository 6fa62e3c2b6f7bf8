"""Fit "delay": timing of the steering from yaw rates, of the throttle from straight driving."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import Vehicle
from dart_lab.identification.fit import MAX_TIME_STD, FittedParameter, SubmodelFit
from dart_lab.identification.submodels.driving import TIMING_NAMES, StraightDriving
from dart_lab.identification.submodels.report import PARAMETER_UNITS, Ledger, make_unidentified
from dart_lab.identification.submodels.steering_timing import (
    MAX_SEPARABLE_STD,
    MIN_INDEPENDENT_DELAY,
    ActuatorTiming,
    divide_delay,
    steering_timing,
)
from dart_lab.identification.submodels.straight import STRAIGHT_NAMES
from dart_lab.identification.submodels.turning import read_yaw_response


def fit_delay(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
              driving: StraightDriving, ledger: Ledger) -> SubmodelFit:
    """Fit steering_s, throttle_s, steering_lag_s, throttle_lag_s; else keep the base's values."""
    begin = time.process_time()
    found = [read_yaw_response(r, reference, base, ledger) for r in recordings]
    series = [s for s in found if s is not None]
    steering = steering_timing(series) if series else None
    throttle = throttle_timing(driving)
    base_values = {n: float(getattr(base.delay, n)) for n in PARAMETER_UNITS["delay"]}
    why = ["steering: hardly changes while the car drives, held at the base's values",
           f"throttle: {driving.why_not or 'hardly changes while the car drives straight'}, held "
           "at the base's values"]
    # Both parts are independent fits: the covariance has a block for each of them.
    known = [part for part in (steering, throttle) if part is not None]
    if not known:
        return make_unidentified("delay", base_values, why, time.process_time() - begin)
    names = list(base_values)
    covariance = np.diag(np.full(4, np.inf))
    entries = {n: FittedParameter(v, np.inf, "s", False) for n, v in base_values.items()}
    notes: list[str] = []
    for part, rows, missing in ((steering, [0, 2], why[0]), (throttle, [1, 3], why[1])):
        if part is None:
            notes.append(missing)
            continue
        covariance[np.ix_(rows, rows)] = part.covariance
        for i, row in enumerate(rows):
            std = float(np.sqrt(part.covariance[i, i]))
            entries[names[row]] = FittedParameter(float(part.values[i]), std, "s",
                                                  part.separable and std < MAX_TIME_STD)
        notes += part.notes
    return SubmodelFit("delay", entries, covariance, known[0].n, known[0].rmse,
                       "rad/s" if steering else "m/s", all(p.converged for p in known), (),
                       time.process_time() - begin, tuple(notes),
                       {} if steering is None else {"command_s": steering.command_s})


def throttle_timing(driving: StraightDriving) -> ActuatorTiming | None:
    """Return the throttle's part of the fit of straight driving; None if it was not fitted."""
    fit = driving.fit
    if fit is None or TIMING_NAMES[0] not in fit.free:
        return None
    rows = [STRAIGHT_NAMES.index(n) for n in TIMING_NAMES]
    covariance = fit.covariance[np.ix_(rows, rows)]
    values = fit.x[rows]
    std = np.sqrt(np.diag(covariance))
    separable = bool((std < MAX_SEPARABLE_STD).all()
                     and (fit.independent[rows] > MIN_INDEPENDENT_DELAY).all())
    total = float(values.sum())
    total_std = float(np.sqrt(max(covariance.sum(), 0.0)))
    notes = [f"throttle, from the command itself: delay and lag together {total:.3f} +- "
             f"{total_std:.3f} s; separately {values[0]:+.3f} +- {std[0]:.3f} and {values[1]:.3f} "
             f"+- {std[1]:.3f} s"]
    if not separable:
        notes.append("throttle: delay and lag cannot be separated by these data; their sum is "
                     "given as a pure delay")
        values = np.array([total, 0.0])
        covariance = divide_delay(total, total_std**2, covariance[1, 1])
    return ActuatorTiming(values, covariance, separable, tuple(notes), len(fit.residual), fit.rmse,
                          fit.converged).subtract_hold(driving.hold, "throttle")
