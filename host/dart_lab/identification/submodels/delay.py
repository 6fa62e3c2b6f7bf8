"""Fit "delay": timing of the steering from yaw rates, of the throttle from straight driving."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import Vehicle
from dart_lab.identification.fit import TIME_KNOWN, Estimate, Fit
from dart_lab.identification.submodels.driving import TIMING, Driving
from dart_lab.identification.submodels.report import UNITS, Ledger, not_identified
from dart_lab.identification.submodels.steering_timing import (
    INDEPENDENT,
    SEPARATE,
    Timing,
    steering_timing,
)
from dart_lab.identification.submodels.straight import NAMES
from dart_lab.identification.submodels.turning import turning_of


def fit_delay(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
              driving: Driving, ledger: Ledger) -> Fit:
    """steering_s, throttle_s, steering_lag_s, throttle_lag_s; the base's if not identifiable."""
    begin = time.process_time()
    found = [turning_of(r, reference, base, ledger) for r in recordings]
    series = [s for s in found if s is not None]
    steering = steering_timing(series) if series else None
    throttle = throttle_timing(driving)
    held = {n: float(getattr(base.delay, n)) for n in UNITS["delay"]}
    why = ["steering: hardly changes while the car drives, held at the base's values",
           f"throttle: {driving.why_not or 'hardly changes while the car drives straight'}, held "
           "at the base's values"]
    known = [part for part in (steering, throttle) if part is not None]
    if not known:
        return not_identified("delay", held, why, time.process_time() - begin)
    names = list(held)
    covariance = np.diag(np.full(4, np.inf))
    entries = {n: Estimate(v, np.inf, "s", False) for n, v in held.items()}
    notes: list[str] = []
    for part, rows, missing in ((steering, [0, 2], why[0]), (throttle, [1, 3], why[1])):
        if part is None:
            notes.append(missing)
            continue
        covariance[np.ix_(rows, rows)] = part.covariance
        for i, row in enumerate(rows):
            std = float(np.sqrt(part.covariance[i, i]))
            entries[names[row]] = Estimate(float(part.values[i]), std, "s",
                                           part.apart and std < TIME_KNOWN)
        notes += part.notes
    return Fit("delay", entries, covariance, known[0].n, known[0].rmse,
               "rad/s" if steering else "m/s", all(p.converged for p in known), (),
               time.process_time() - begin, tuple(notes),
               {} if steering is None else {"command_s": steering.command_s})


def throttle_timing(driving: Driving) -> Timing | None:
    """The throttle's part of the fit of straight driving; None when it was held."""
    fit = driving.fit
    if fit is None or TIMING[0] not in fit.free:
        return None
    rows = [NAMES.index(n) for n in TIMING]
    covariance, values = fit.covariance[np.ix_(rows, rows)], fit.x[rows]
    std = np.sqrt(np.diag(covariance))
    apart = bool((std < SEPARATE).all() and (fit.independent[rows] > INDEPENDENT).all())
    total, total_std = float(values.sum()), float(np.sqrt(max(covariance.sum(), 0.0)))
    notes = [f"throttle, from the command itself: delay and lag together {total:.3f} +- "
             f"{total_std:.3f} s; apart {values[0]:+.3f} +- {std[0]:.3f} and {values[1]:.3f} +- "
             f"{std[1]:.3f} s"]
    if not apart:
        notes.append("throttle: delay and lag cannot be told apart by these data; their sum is "
                     "given as a pure delay")
        values = np.array([total, 0.0])
    return Timing(values, covariance, apart, tuple(notes), len(fit.residual), fit.rmse,
                  fit.converged).held(driving.hold, "throttle")
