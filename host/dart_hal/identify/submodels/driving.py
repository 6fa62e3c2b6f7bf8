"""Which of friction, motor and throttle timing the straight driving can tell, and their fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.identify.fit import Estimate
from dart_hal.identify.submodels.guess import first_guess
from dart_hal.identify.submodels.report import Ledger
from dart_hal.identify.submodels.speeds import SETTLE, WINDOW, Speeds, speeds_of
from dart_hal.identify.submodels.straight import NAMES, Straight, solve_straight
from dart_hal.identify.submodels.stretches import SHORTEST, cut
from dart_hal.recording.dart import Recording, Reference
from dart_hal.recording.dart.model import IntArray
from dart_hal.types import FloatArray
from dart_hal.vehicle import Vehicle

LEAST = 30  # samples: 3 s of straight driving
COASTING, DRIVEN = 10, 30  # samples that a fit needs of each
LEVEL = 0.03  # of throttle: closer levels are one
FRICTION, MOTOR, TIMING = ("a", "b", "c"), ("d", "e", "g"), ("throttle_s", "throttle_lag_s")


@dataclass(frozen=True, slots=True)
class Driving:
    """The fit, or None with the reason; counts of what the recordings hold.

    coasting, driven: samples; level_span: of the throttle while driven;
    slowest, fastest m/s; changes: throttle steps within the driving.
    """

    series: tuple[Speeds, ...]
    fit: Straight | None
    why_not: str
    coasting: int
    driven: int
    level_span: float
    slowest: float
    fastest: float
    changes: int


def drive(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
          mass: Estimate | None, ledger: Ledger, only_friction: bool = False) -> Driving:
    """Cut, count, decide what is free, fit."""
    found = [speeds_of(r, reference, ledger) for r in recordings]
    series = [s for s in found if s is not None]
    throttle = [_recent(s) for s in series]
    if only_friction:
        series = [c for s, t in zip(series, throttle, strict=True)
                  if (c := _coasting(s, t)) is not None]
        throttle = [_recent(s) for s in series]
    v = np.concatenate([s.v for s in series]) if series else np.zeros(0)
    tau = np.concatenate(throttle) if throttle else np.zeros(0)
    driven = tau[tau > 0.0]
    counts = Driving(tuple(series), None, "", int((tau == 0.0).sum()), len(driven),
                     float(np.ptp(driven)) if len(driven) else 0.0,
                     float(v.min(initial=np.inf)), float(v.max(initial=0.0)),
                     sum(int((np.diff(t) != 0.0).sum()) for t in throttle))
    if len(v) < LEAST:
        what = "coasting" if only_friction else "straight driving"
        return replace(counts, why_not=f"{len(v) * WINDOW:.1f} s of {what}, at least "
                                       f"{LEAST * WINDOW:.0f} s needed")
    kilograms = base.body.mass if mass is None else mass.value
    x0 = first_guess(series, base, kilograms)
    free = _free(counts)
    if not free:
        return replace(counts, why_not="neither coasting nor a driven stretch long enough")
    held = [i for i, n in enumerate(NAMES) if n not in free]
    x0[held] = _of(base)[held]
    fit = solve_straight(series, cut(series), base, x0, free, kilograms,
                         0.0 if mass is None else mass.std)
    return replace(counts, fit=fit)


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


def _recent(s: Speeds) -> FloatArray:
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
