"""Fit "tyres": what the mocap tells of both axles, and what on-board sensors alone can tell."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.calibration.sessions import session_of
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import PaperTyres, Vehicle
from dart_hal.vehicle.fitting.random_effects import random_effects
from dart_lab.identification.fit import Estimate, Fit
from dart_lab.identification.submodels.report import UNITS, Ledger, not_identified
from dart_lab.identification.submodels.tyre_fit import REAR_RANGE, fit_curves
from dart_lab.identification.submodels.tyre_forces import MIN_LATERAL, TyreForces, tyre_forces
from dart_lab.identification.submodels.understeer import understeer_note

NAMES = ("front_D", "front_C", "front_B", "rear_cornering_stiffness")
NOTHING_KNOWN = np.array([20.0, 100.0, 100.0])  # N, N/rad, N/rad: std that stands for "nothing"
MIN_SAMPLES = 100  # samples of 0.1 s
SHAPE = 1.0  # C where it cannot be told from D: the force rises towards D and stays
MAX_RELATIVE = 0.25  # std over value of what counts as identified
LINEAR = 0.6  # of B alpha: less of it shows no bend, hence no D
GAIN = 0.2  # how far a recording's forces may lie from the model's


@dataclass(frozen=True, slots=True)
class Curves:
    """x (4,) as NAMES; apart: C told from D; bent: slip reaches where the force bends."""

    x: FloatArray
    covariance: FloatArray
    apart: bool
    bent: bool
    front: FloatArray
    rear: FloatArray
    converged: bool
    stopped: tuple[str, ...]


def fit_tyres(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
              car: Vehicle, ledger: Ledger) -> Fit:
    """car: base with the steering map and delay to use. Errors: none, see ``not_identified``."""
    begin = time.process_time()
    sessions: dict[str, list[TyreForces]] = {}
    for recording in recordings:
        part = tyre_forces(recording, reference, car, ledger)
        if part is not None:
            sessions.setdefault(session_of(recording), []).append(part)
    enough = {k: v for k, v in sessions.items() if sum(len(p.rows) for p in v) >= MIN_SAMPLES}
    if not enough:
        n = sum(len(p.rows) for v in sessions.values() for p in v)
        seen = any(r.mocap is not None for r in recordings)
        why = (f"{n} samples of motion capture in recordings with {MIN_LATERAL} m/s2 and more, "
               f"at least {MIN_SAMPLES} of one session needed" if seen
               else "no motion capture: without side slip the two axles cannot be told apart")
        said = [why, understeer_note(recordings, reference, car)]
        return not_identified("tyres", _held(base), said, time.process_time() - begin)
    parts = [p for v in enough.values() for p in v]
    if len(enough) == 1:
        result, notes = _one(parts)
    else:
        result, notes = _many(enough)
    notes = [_range(parts), *notes, "E held at 0; forces for the base's mass and yaw inertia, "
             f"taken as exact; steering delayed by {car.delay.steering_s:.3f} s, lag "
             f"{car.delay.steering_lag_s:.3f} s"]
    return _fit(result, notes, time.process_time() - begin)


def _one(parts: Sequence[TyreForces]) -> tuple[Curves, list[str]]:
    """One session: C free if the data tell it from D."""
    three = fit_curves(parts, None)
    apart = bool(np.sqrt(three.covariance[1, 1]) < MAX_RELATIVE * three.x[1]
                 and not any(three.stopped))
    fit = three if apart else fit_curves(parts, SHAPE)
    notes = [_stiffness(fit.stiffness, fit.stiffness_std, fit.x[3], fit.covariance[3, 3])]
    if not apart:
        notes.append(f"front D and C cannot be told apart (C {three.x[1]:.2f} +- "
                     f"{np.sqrt(three.covariance[1, 1]):.2f}): C held at {SHAPE:g}; with C free "
                     f"the stiffness is {three.stiffness:.1f} +- {three.stiffness_std:.1f} N/rad")
    for part, (front, rear) in zip(parts, fit.gains, strict=True):
        if max(abs(front - 1.0), abs(rear - 1.0)) > GAIN:
            notes.append(f"caution: {part.name} has {front:.2f} of the front's and {rear:.2f} of "
                         "the rear's force: another floor or car; fit it apart")
    stopped = tuple(n for n, s in zip(NAMES, fit.stopped, strict=True) if s)
    return Curves(fit.x, fit.covariance, apart, _bent(parts, fit.x[2]), fit.front, fit.rear,
                  fit.converged, stopped), notes


def _many(sessions: Mapping[str, Sequence[TyreForces]]) -> tuple[Curves, list[str]]:
    """Several sessions: floors and tyres differ, so each by itself, then a random-effects mean.

    Averaged are D, the stiffness BCD and C_r with C held: these mean the same
    on every floor, B by itself does not.
    """
    fits = {name: fit_curves(parts, SHAPE) for name, parts in sessions.items()}
    points, errors, notes = [], [], []
    for name, fit in fits.items():
        turn = np.array([[1.0, 0.0, 0.0], [SHAPE * fit.x[2], SHAPE * fit.x[0], 0.0],
                         [0.0, 0.0, 1.0]])
        own = turn @ fit.covariance[np.ix_([0, 2, 3], [0, 2, 3])] @ turn.T
        bent = _bent(sessions[name], fit.x[2])
        useless = np.array([not bent or fit.stopped[0] or fit.stopped[2],
                            fit.stopped[0] or fit.stopped[2], fit.stopped[3]])
        useless = useless | (np.sqrt(np.diag(own)) > NOTHING_KNOWN) | (not fit.converged)
        own[useless, :] = own[:, useless] = 0.0
        own[useless, useless] = NOTHING_KNOWN[useless] ** 2
        points.append([fit.x[0], fit.stiffness, fit.x[3]])
        errors.append(own)
        if not useless.all():
            notes.append(f"{name}: " + ", ".join(
                f"{label} {value:.3g} +- {np.sqrt(own[i, i]):.2g}" for i, (label, value)
                in enumerate(zip(("D", "front N/rad", "rear N/rad"), points[-1], strict=True))
                if not useless[i]))
    mean, covariance, between = random_effects(np.array(points), np.array(errors))
    d, k = float(mean[0]), float(mean[1])
    back = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-k / d**2 / SHAPE, 1.0 / d / SHAPE, 0.0],
                     [0.0, 0.0, 1.0]])
    notes = [f"{len(fits)} sessions fitted apart and averaged (front C held at {SHAPE:g}: not "
             "identifiable beside D); the rmse is that of their own fits; "
             "standard deviation between them: D "
             f"{np.sqrt(between[0]):.2g} N, front {np.sqrt(between[1]):.2g}, rear "
             f"{np.sqrt(between[2]):.2g} N/rad: floors and steering trims differ, so fit yours "
             "apart", _stiffness(k, np.sqrt(covariance[1, 1]), mean[2], covariance[2, 2]), *notes]
    return Curves(np.array([d, SHAPE, k / d / SHAPE, mean[2]]), back @ covariance @ back.T, False,
                  any(_bent(v, fits[n].x[2]) for n, v in sessions.items()),
                  np.concatenate([f.front for f in fits.values()]),
                  np.concatenate([f.rear for f in fits.values()]),
                  any(f.converged for f in fits.values()), ()), notes


def _fit(c: Curves, notes: list[str], cpu_s: float) -> Fit:
    std = np.sqrt(np.diag(c.covariance))
    units = UNITS["tyres"]
    values = [*c.x[:3], 0.0, c.x[3]]
    errors = [std[0], std[1] if c.apart else np.inf, std[2], np.inf, std[3]]
    known = [c.bent, c.apart, c.bent, False, True]
    entries = {name: Estimate(float(v), float(e), units[name],
                              bool(k and e < MAX_RELATIVE * abs(v)))
               for name, v, e, k in zip(units, values, errors, known, strict=True)}
    covariance = np.diag(np.where(np.isfinite(errors), 0.0, np.inf))
    inner = c.covariance.copy()
    if not c.apart:
        inner[1, 1] = np.inf
    covariance[np.ix_([0, 1, 2, 4], [0, 1, 2, 4])] = inner
    if not c.bent:
        notes = [*notes, "the front's slip stays where its force is a straight line: D and B are "
                 "not identifiable, only their product"]
    notes.append(f"residual {np.sqrt(np.mean(c.front**2)):.3f} N in front, "
                 f"{np.sqrt(np.mean(c.rear**2)):.3f} N behind")
    residual = np.concatenate([c.front, c.rear])
    return Fit("tyres", entries, covariance, len(residual),
               float(np.sqrt(np.mean(residual**2))), "N", c.converged, c.stopped, cpu_s,
               tuple(notes))


def _bent(parts: Sequence[TyreForces], stiffness: float) -> bool:
    alpha = np.concatenate([p.alpha_f[p.rows] for p in parts])
    return bool(np.quantile(np.abs(alpha), 0.98) * stiffness > LINEAR)


def _held(base: Vehicle) -> dict[str, float]:
    t = base.tyres
    if isinstance(t, PaperTyres):
        return {n: float(getattr(t, n)) for n in UNITS["tyres"]}
    front, rear = base.body.front_load, base.body.rear_load
    return {"front_D": t.front_D * front, "front_C": t.front_C, "front_B": t.front_B,
            "front_E": 0.0, "rear_cornering_stiffness": t.rear_D * t.rear_C * t.rear_B * rear}


def _range(parts: Sequence[TyreForces]) -> str:
    front = np.concatenate([p.alpha_f[p.rows] for p in parts])
    behind = np.concatenate([p.alpha_r[p.rows] for p in parts])
    lateral = np.concatenate([np.abs(p.lateral) for p in parts])
    low, high = np.degrees(np.quantile(front, (0.01, 0.99)))
    low_r, high_r = np.degrees(np.quantile(behind, (0.01, 0.99)))
    return (f"{len(parts)} recording(s) with motion capture, slip {low:+.1f} to {high:+.1f} deg in "
            f"front, {low_r:+.1f} to {high_r:+.1f} deg behind (98 % of the samples), up to "
            f"{np.quantile(lateral, 0.99):.1f} m/s2")


def _stiffness(front: float, front_std: float, rear: float, rear_variance: float) -> str:
    return (f"stiffness at small slip: front {front:.1f} +- {front_std:.1f} N/rad "
            f"({np.radians(front):.3f} N/deg), rear {rear:.1f} +- {np.sqrt(rear_variance):.1f} "
            f"N/rad ({np.radians(rear):.3f} N/deg, within {np.degrees(REAR_RANGE):.1f} deg)")
