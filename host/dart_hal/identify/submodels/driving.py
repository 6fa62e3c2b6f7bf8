"""Which of friction, motor and throttle timing the straight driving can tell, and their fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.identify.fit import Estimate
from dart_hal.identify.submodels.guess import first_guess
from dart_hal.identify.submodels.report import Ledger
from dart_hal.identify.submodels.sessions import combine, session_of
from dart_hal.identify.submodels.speeds import SETTLE, WINDOW, Speeds, speeds_of
from dart_hal.identify.submodels.straight import NAMES, Straight, solve_straight
from dart_hal.identify.submodels.stretches import SHORTEST, cut
from dart_hal.recording.dart import Recording, Reference
from dart_hal.recording.dart.model import IntArray
from dart_hal.types import FloatArray
from dart_hal.vehicle import Vehicle

LEAST = 30  # samples: 3 s of straight driving
SESSION = 100  # samples of a session beside others; of fewer, eight errors are not known
COASTING, DRIVEN = 10, 30  # samples that a fit needs of each
LEVEL = 0.03  # of throttle: closer levels are one
TOLERANCE = 3.0  # standard errors
FRICTION, MOTOR, TIMING = ("a", "b", "c"), ("d", "e", "g"), ("throttle_s", "throttle_lag_s")


@dataclass(frozen=True, slots=True)
class Driving:
    """The fit, or None with the reason; counts of what the recordings hold.

    samples, of them coasting and driven; level_span: of the throttle while
    driven; slowest, fastest m/s; changes: throttle steps within the driving;
    hold [s]: of the logged throttle.
    """

    fit: Straight | None
    why_not: str
    samples: int
    coasting: int
    driven: int
    level_span: float
    slowest: float
    fastest: float
    changes: int
    hold: float
    notes: tuple[str, ...] = ()


def drive(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
          mass: Estimate | None, ledger: Ledger, only_friction: bool = False) -> Driving:
    """Cut, count, decide what is free, fit each session, combine them."""
    series: list[Speeds] = []
    sessions: list[str] = []
    for recording in recordings:
        found = speeds_of(recording, reference, ledger)
        if found is not None and only_friction:
            found = _coasting(found, recent_throttle(found))
        if found is not None:
            series.append(found)
            sessions.append(session_of(recording))
    everything = _count(series)
    kilograms = base.body.mass if mass is None else mass.value
    if everything.samples < LEAST:
        what = "coasting" if only_friction else "straight driving"
        return replace(everything, why_not=f"{everything.samples * WINDOW:.1f} s of {what}, at "
                                           f"least {LEAST * WINDOW:.0f} s needed")
    parts: dict[str, Straight] = {}
    groups, small = _sessions(series, sessions)
    for session, some in groups.items():
        fit = _fit(some, base, kilograms)
        if fit is not None:
            parts[session] = fit
    if not parts:
        return replace(everything, why_not="neither coasting nor a driven stretch long enough")
    fit, notes = combine(parts)
    notes += [f"{name}: too little straight driving to be fitted apart, left out" for name in small]
    notes += _coasting_alone(series, base, kilograms, fit)
    return replace(everything, fit=fit.with_mass(kilograms, 0.0 if mass is None else mass.std),
                   notes=tuple(notes))


def _sessions(series: Sequence[Speeds], names: Sequence[str]
              ) -> tuple[dict[str, list[Speeds]], list[str]]:
    """(recordings by session, names of sessions too small); all as one if none is large enough."""
    groups: dict[str, list[Speeds]] = {}
    for s, name in zip(series, names, strict=True):
        groups.setdefault(name, []).append(s)
    small = [n for n, some in groups.items() if sum(map(len, some)) < SESSION]
    if len(small) == len(groups):
        return {"all": list(series)}, []
    return {n: some for n, some in groups.items() if n not in small}, small


def _fit(series: Sequence[Speeds], base: Vehicle, mass: float) -> Straight | None:
    counts = _count(series)
    free = _free(counts)
    if not free or counts.samples < LEAST:
        return None
    x0 = first_guess(series, base, mass)
    held = [i for i, n in enumerate(NAMES) if n not in free]
    x0[held] = _of(base)[held]
    return solve_straight(series, cut(series), base, x0, free, mass)


def _coasting_alone(series: Sequence[Speeds], base: Vehicle, mass: float, joint: Straight
                    ) -> list[str]:
    """Says so when driven motion moves the friction: then the motor's form does not hold."""
    alone = [c for s in series if (c := _coasting(s, recent_throttle(s))) is not None]
    if "d" not in joint.free or "a" not in joint.free or sum(map(len, alone)) < LEAST:
        return []
    fit = _fit(alone, base, mass)
    if fit is None or "a" not in fit.free:
        return []
    apart = [n for n in ("a", "c") if abs(fit.value(n) - joint.value(n))
             > TOLERANCE * np.hypot(fit.std(n), joint.std(n))]
    if not apart:
        return []
    return ["coasting alone gives " + ", ".join(
        f"{n} {fit.value(n):.3f} +- {fit.std(n):.3f}" for n in FRICTION)
        + ": the driven motion moves the friction, so the form of motor or friction does not hold"]


def _count(series: Sequence[Speeds]) -> Driving:
    throttle = [recent_throttle(s) for s in series]
    v = np.concatenate([s.v for s in series]) if series else np.zeros(0)
    tau = np.concatenate(throttle) if throttle else np.zeros(0)
    driven = tau[tau > 0.0]
    return Driving(None, "", len(v), int((tau == 0.0).sum()), len(driven),
                   float(np.ptp(driven)) if len(driven) else 0.0, float(v.min(initial=np.inf)),
                   float(v.max(initial=0.0)),
                   sum(int((np.diff(t) != 0.0).sum()) for t in throttle),
                   float(np.mean([s.throttle.hold for s in series])) if series else 0.0)


def _free(c: Driving) -> tuple[str, ...]:
    free: tuple[str, ...] = ()
    if c.coasting >= COASTING:
        free += FRICTION
    if c.driven >= DRIVEN:
        free += MOTOR if c.level_span >= LEVEL else ("d", "e")
        free += TIMING if c.changes else ()
    return free


def _of(base: Vehicle) -> FloatArray:
    f, m, t = base.friction, base.motor, base.delay
    return np.array([f.a, f.b, f.c, m.d, m.e, m.g, t.throttle_s, t.throttle_lag_s])


def recent_throttle(s: Speeds) -> FloatArray:
    """Largest throttle (n,) held during the last 0.5 s before each sample."""
    stairs = s.throttle
    last = np.clip(np.searchsorted(stairs.t, s.t, side="right") - 1, 0, None)
    first = np.clip(np.searchsorted(stairs.t, s.t - SETTLE, side="right") - 1, 0, None)
    out = stairs.value[last]
    for step in range(1, int((last - first).max(initial=0)) + 1):
        out = np.maximum(out, stairs.value[np.maximum(last - step, first)])
    return np.asarray(out)


def _coasting(s: Speeds, recent: FloatArray) -> Speeds | None:
    """Only the samples that coast, in runs of their own."""
    rows = np.flatnonzero(recent == 0.0)
    cut_here = np.diff(rows) > 1
    run: IntArray = s.run[rows] * 1000 + np.concatenate([[0], np.cumsum(cut_here)])
    label, count = np.unique(run, return_counts=True)
    keep = np.isin(run, label[count >= SHORTEST])
    rows, run = rows[keep], run[keep]
    if not len(rows):
        return None
    return replace(s, t=s.t[rows], v=s.v[rows], run=run)
