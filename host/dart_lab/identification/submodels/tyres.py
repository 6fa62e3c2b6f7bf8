"""Fit "tyres": both axles from mocap, or one combination of them from on-board sensors."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.calibration.sessions import session_of
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import PaperTyres, Vehicle
from dart_hal.vehicle.fitting.random_effects import random_effects
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.submodels.report import PARAMETER_UNITS, Ledger, make_unidentified
from dart_lab.identification.submodels.tyre_fit import (
    MAX_REAR_SLIP,
    SHAPE_MEAN,
    SHAPE_STD,
    TyreFit,
    find_stiffness_std,
    fit_curves,
)
from dart_lab.identification.submodels.tyre_forces import MIN_LATERAL, TyreForces, tyre_forces
from dart_lab.identification.submodels.understeer import describe_understeer

CURVE_NAMES = tuple(PARAMETER_UNITS["tyres"])
# [N, N/rad, N/rad] of a car of 1:10: standard deviations of D, BCD and C_r that a session does not
# identify.
UNKNOWN_STD = np.array([20.0, 100.0, 100.0])
# Samples of 0.1 s that a session needs.
MIN_SESSION_FORCES = 100
# Largest standard error over value of an identified parameter.
MAX_TYRE_RELATIVE_STD = 0.25
# B alpha: the curve is straight below it, and D does not show.
MIN_BENT_SLIP = 0.6
# Largest |measured force / model's force - 1| of a recording without a caution.
MAX_FORCE_DEVIATION = 0.2


@dataclass(frozen=True, slots=True)
class TyreCurves:
    """Tyre curves of one or several sessions.

    x (5,) as CURVE_NAMES; reaches_bend: the slip reaches the bend of the curve.
    """

    x: FloatArray
    covariance: FloatArray
    reaches_bend: bool
    front: FloatArray
    rear: FloatArray
    converged: bool
    stopped: tuple[str, ...]


def fit_tyres(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
              car: Vehicle, variants: Sequence[Vehicle], ledger: Ledger) -> SubmodelFit:
    """Fit the tyre curves.

    car: base with the steering map and delay to use; variants: the same, each with one standard
    error of these. Raises nothing: without enough data it returns ``make_unidentified``.
    """
    begin = time.process_time()
    sessions = _forces_by_session(recordings, reference, car, ledger)
    enough = {k: v for k, v in sessions.items()
              if sum(len(p.rows) for p in v) >= MIN_SESSION_FORCES}
    if not enough:
        n = sum(len(p.rows) for v in sessions.values() for p in v)
        has_mocap = any(r.mocap is not None for r in recordings)
        why = (f"{n} samples of motion capture in recordings with {MIN_LATERAL} m/s2 and more, "
               f"at least {MIN_SESSION_FORCES} of one session needed" if has_mocap
               else "no motion capture: without side slip the two axles cannot be separated")
        notes = [why, describe_understeer(recordings, reference, car)]
        return make_unidentified("tyres", _base_values(base), notes, time.process_time() - begin)
    parts = [p for v in enough.values() for p in v]
    if len(enough) == 1:
        result, notes = _fit_one_session(parts)
    else:
        result, notes = _fit_sessions(enough)
    # Errors of what was held fixed: the curves are fitted again with each of them.
    covariance = result.covariance.copy()
    for variant in variants:
        moved = _forces_by_session(recordings, reference, variant, Ledger())
        change = _find_curve({k: moved.get(k, v) for k, v in enough.items()}) - result.x
        covariance += np.outer(change, change)
    result = replace(result, covariance=covariance)
    notes = [_describe_range(parts), *notes,
             "forces for the base's mass and yaw inertia, "
             f"taken as exact; steering delayed by {car.delay.steering_s:.3f} s, lag "
             f"{car.delay.steering_lag_s:.3f} s"]
    return _make_fit(result, notes, time.process_time() - begin)


def _forces_by_session(recordings: Sequence[Recording], reference: Reference | None, car: Vehicle,
                       ledger: Ledger) -> dict[str, list[TyreForces]]:
    out: dict[str, list[TyreForces]] = {}
    for recording in recordings:
        part = tyre_forces(recording, reference, car, ledger)
        if part is not None:
            out.setdefault(session_of(recording), []).append(part)
    return out


def _find_curve(sessions: Mapping[str, Sequence[TyreForces]]) -> FloatArray:
    """Return (D, C, B, E, C_r) (5,) of one session, or the average of several."""
    if len(sessions) == 1:
        return fit_curves(next(iter(sessions.values())), with_spread=False).x
    return _average(sessions, SHAPE_MEAN)


def _fit_one_session(parts: Sequence[TyreForces]) -> tuple[TyreCurves, list[str]]:
    """Fit one session, with the priors of C and E."""
    fit = fit_curves(parts)
    notes = []
    for part, (front, rear) in zip(parts, fit.force_ratios, strict=True):
        if max(abs(front - 1.0), abs(rear - 1.0)) > MAX_FORCE_DEVIATION:
            notes.append(f"caution: {part.name} has {front:.2f} of the front's and {rear:.2f} of "
                         "the rear's force: another floor or car; fit it separately")
    stopped = tuple(n for n, s in zip(CURVE_NAMES, fit.stopped, strict=True) if s)
    return TyreCurves(fit.x, fit.covariance, _reaches_bend(parts, fit.x[2]), fit.front,
                      fit.rear, fit.converged, stopped), notes


def _fit_sessions(sessions: Mapping[str, Sequence[TyreForces]]) -> tuple[TyreCurves, list[str]]:
    """Fit each session and average them by a random-effects model: floors and tyres differ.

    1. Fit D, B and C_r of each session with C and E at the means of their priors.
    2. Transform to (D, BCD, C_r): these mean the same on every floor, B by itself does not.
    3. Replace what a session does not identify by 0 +- unknown_std.
    4. Average, and transform back to (D, C, B, E, C_r).
    5. Repeat this with C and with E one standard deviation of its prior away, to both sides. The
       larger change of each is an added error.
    """
    fits = {name: fit_curves(parts, SHAPE_MEAN) for name, parts in sessions.items()}
    points, errors, notes = _compare_sessions(sessions, fits)
    mean, covariance, between = random_effects(points, errors)
    x = _restore_curve(mean, SHAPE_MEAN)
    # d(D, C, B, E, C_r) / d(D, BCD, C_r)
    d, c, b = x[:3].tolist()
    back = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-b / d, 1.0 / d / c, 0.0],
                     [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    total = back @ covariance @ back.T
    for step in np.diag(SHAPE_STD):
        changes = [_average(sessions, SHAPE_MEAN + side * step) - x for side in (1.0, -1.0)]
        # Compared by D, which varies most with C and E.
        change = max(changes, key=lambda c: abs(float(c[0])))
        total += np.outer(change, change)
    notes = [f"{len(fits)} sessions fitted separately and averaged, with C and E at the means "
             "of their priors; the rmse is that of their own fits; standard deviation "
             f"between them: D {np.sqrt(between[0]):.2g} N, front {np.sqrt(between[1]):.2g}, rear "
             f"{np.sqrt(between[2]):.2g} N/rad: floors and steering trims differ, so fit yours "
             "separately", *notes]
    return TyreCurves(x, total, any(_reaches_bend(v, fits[n].x[2]) for n, v in sessions.items()),
                      np.concatenate([f.front for f in fits.values()]),
                      np.concatenate([f.rear for f in fits.values()]),
                      any(f.converged for f in fits.values()), ()), notes


def _average(sessions: Mapping[str, Sequence[TyreForces]], shape: FloatArray) -> FloatArray:
    """Return (D, C, B, E, C_r) (5,) of the average of sessions, each fitted with C and E fixed."""
    fits = {name: fit_curves(parts, shape) for name, parts in sessions.items()}
    points, errors, _ = _compare_sessions(sessions, fits)
    return _restore_curve(random_effects(points, errors)[0], shape)


def _compare_sessions(sessions: Mapping[str, Sequence[TyreForces]], fits: Mapping[str, TyreFit]
                      ) -> tuple[FloatArray, FloatArray, list[str]]:
    """Return (D, BCD, C_r) (s, 3) of each session, their covariances (s, 3, 3) and notes."""
    unknown_std = UNKNOWN_STD * next(iter(sessions.values()))[0].force_scale
    points = []
    errors = []
    notes = []
    for name, fit in fits.items():
        d, c, b = fit.x[:3].tolist()
        # d(D, BCD, C_r) / d(D, C, B, E, C_r)
        to_stiffness = np.array([[1.0, 0.0, 0.0, 0.0, 0.0], [b * c, b * d, c * d, 0.0, 0.0],
                                 [0.0, 0.0, 0.0, 0.0, 1.0]])
        own = to_stiffness @ fit.covariance @ to_stiffness.T
        reaches_bend = _reaches_bend(sessions[name], fit.x[2])
        useless = np.array([not reaches_bend or fit.stopped[0] or fit.stopped[2],
                            fit.stopped[0] or fit.stopped[2], fit.stopped[4]])
        useless = useless | (np.sqrt(np.diag(own)) > unknown_std) | (not fit.converged)
        own[useless, :] = own[:, useless] = 0.0
        own[useless, useless] = unknown_std[useless] ** 2
        points.append([fit.x[0], fit.stiffness, fit.x[4]])
        errors.append(own)
        if not useless.all():
            notes.append(f"{name}: " + ", ".join(
                f"{label} {value:.3g} +- {np.sqrt(own[i, i]):.2g}" for i, (label, value)
                in enumerate(zip(("D", "front N/rad", "rear N/rad"), points[-1], strict=True))
                if not useless[i]))
    return np.array(points), np.array(errors), notes


def _restore_curve(point: FloatArray, shape: FloatArray) -> FloatArray:
    """Return (D, C, B, E, C_r) of a point (D, BCD, C_r) with the shape (C, E)."""
    d, stiffness, rear = point.tolist()
    c, e = shape.tolist()
    return np.array([d, c, stiffness / d / c, e, rear])


def _make_fit(c: TyreCurves, notes: list[str], cpu_s: float) -> SubmodelFit:
    std = np.sqrt(np.diag(c.covariance))
    units = PARAMETER_UNITS["tyres"]
    known = [c.reaches_bend, True, c.reaches_bend, True, True]
    entries = {name: FittedParameter(float(v), float(e), units[name],
                                     bool(k and e < MAX_TYRE_RELATIVE_STD * abs(v)))
               for name, v, e, k in zip(units, c.x, std, known, strict=True)}
    notes = [*notes, _describe_stiffness(c.x, c.covariance)]
    if not entries["front_C"].identifiable:
        notes = [*notes, f"front D, C, B and E cannot be separated: C {c.x[1]:.2f} +- "
                 f"{std[1]:.2f} (prior {SHAPE_MEAN[0]:g} +- {SHAPE_STD[0]:g}), E {c.x[3]:.2f} +- "
                 f"{std[3]:.2f} (prior {SHAPE_MEAN[1]:g} +- {SHAPE_STD[1]:g}); the curve is that "
                 "of the four together"]
    if not c.reaches_bend:
        notes = [*notes, "the front's slip stays where its force is a straight line: D and B are "
                 "not identifiable, only their product"]
    notes.append(f"residual {np.sqrt(np.mean(c.front**2)):.3f} N in front, "
                 f"{np.sqrt(np.mean(c.rear**2)):.3f} N behind")
    residual = np.concatenate([c.front, c.rear])
    return SubmodelFit("tyres", entries, c.covariance, len(residual),
                       float(np.sqrt(np.mean(residual**2))), "N", c.converged, c.stopped, cpu_s,
                       tuple(notes))


def _reaches_bend(parts: Sequence[TyreForces], stiffness: float) -> bool:
    alpha = np.concatenate([p.alpha_f[p.rows] for p in parts])
    return bool(np.quantile(np.abs(alpha), 0.98) * stiffness > MIN_BENT_SLIP)


def _base_values(base: Vehicle) -> dict[str, float]:
    t = base.tyres
    if isinstance(t, PaperTyres):
        return {n: float(getattr(t, n)) for n in PARAMETER_UNITS["tyres"]}
    front, rear = base.body.front_load, base.body.rear_load
    return {"front_D": t.front_D * front, "front_C": t.front_C, "front_B": t.front_B,
            "front_E": 0.0, "rear_cornering_stiffness": t.rear_D * t.rear_C * t.rear_B * rear}


def _describe_range(parts: Sequence[TyreForces]) -> str:
    front = np.concatenate([p.alpha_f[p.rows] for p in parts])
    behind = np.concatenate([p.alpha_r[p.rows] for p in parts])
    lateral = np.concatenate([np.abs(p.lateral) for p in parts])
    low, high = np.degrees(np.quantile(front, (0.01, 0.99)))
    low_r, high_r = np.degrees(np.quantile(behind, (0.01, 0.99)))
    return (f"{len(parts)} recording(s) with motion capture, slip {low:+.1f} to {high:+.1f} deg in "
            f"front, {low_r:+.1f} to {high_r:+.1f} deg behind (98 % of the samples), up to "
            f"{np.quantile(lateral, 0.99):.1f} m/s2")


def _describe_stiffness(x: FloatArray, covariance: FloatArray) -> str:
    front = float(x[0] * x[1] * x[2])
    front_std = find_stiffness_std(x, covariance)
    rear = float(x[4])
    return (f"stiffness at small slip: front {front:.1f} +- {front_std:.1f} N/rad "
            f"({np.radians(front):.3f} N/deg), rear {rear:.1f} +- {np.sqrt(covariance[4, 4]):.1f} "
            f"N/rad ({np.radians(rear):.3f} N/deg, within {np.degrees(MAX_REAR_SLIP):.1f} deg)")
