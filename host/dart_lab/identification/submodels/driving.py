"""Which of friction, motor and throttle timing the straight driving can tell, and their fit.

Friction first, from coasting alone, then the motor from driven stretches with
that friction and its errors: fitted together, whatever the motor's form cannot
follow would go into the friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.calibration.sessions import sessions_of
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import Vehicle
from dart_lab.identification.fit import Estimate
from dart_lab.identification.submodels.coasting import (
    IDLE,
    coasting,
    driven,
    fit_coasting,
    recent_throttle,
)
from dart_lab.identification.submodels.guess import first_guess
from dart_lab.identification.submodels.motor_fit import band_notes, fit_motor
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import WINDOW, Speeds, speeds_of
from dart_lab.identification.submodels.straight import NAMES, Straight, solve_straight
from dart_lab.identification.submodels.stretches import cut

MIN_SAMPLES = 30  # samples: 3 s of straight driving
MIN_SESSION = 30  # driven samples of a session beside others
MIN_DRIVEN = 30  # samples that a fit of the motor needs
LEVEL = 0.03  # of throttle: closer levels are one
MOTOR, TIMING = ("d", "e", "g"), ("throttle_s", "throttle_lag_s")


@dataclass(frozen=True, slots=True)
class Driving:
    """The fit, or None with the reason; counts of what the recordings hold.

    fit: friction, motor and timing with all covariances, its residual that of
    driven motion; coast: the fit of the coasting; samples, of them coasting and
    driven; level_span: of the throttle while driven; slowest, fastest m/s;
    changes: throttle steps within the driving; hold [s]: of the logged throttle.
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
    coast: Straight | None = None
    coast_notes: tuple[str, ...] = ()


def drive(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
          mass: Estimate | None, ledger: Ledger, only_friction: bool = False) -> Driving:
    """Cut, count, decide what is free, fit the coasting, then what is driven."""
    series: list[Speeds] = []
    sessions: list[str] = []
    for recording, session in zip(recordings, sessions_of(recordings), strict=True):
        one = speeds_of(recording, reference, ledger)
        if one is not None and only_friction:
            one = coasting(one)
        if one is not None:
            series.append(one)
            sessions.append(session)
    everything = _count(series)
    kilograms, vague = (base.body.mass, 0.0) if mass is None else (mass.value, mass.std)
    if everything.samples < MIN_SAMPLES:
        what = "coasting" if only_friction else "straight driving"
        return replace(everything, why_not=f"{everything.samples * WINDOW:.1f} s of {what}, at "
                                           f"least {MIN_SAMPLES * WINDOW:.0f} s needed")
    coast, said = fit_coasting(series, sessions, base, kilograms)
    fit, notes = _motor(series, sessions, base, kilograms, coast)
    found = fit or coast
    if found is None:
        return replace(everything, why_not="neither coasting nor a driven stretch long enough")
    return replace(
        everything, fit=found.with_mass(kilograms, vague), notes=tuple(notes),
        coast=None if coast is None else coast.with_mass(kilograms, vague),
        coast_notes=tuple(said))


def _motor(series: Sequence[Speeds], sessions: Sequence[str], base: Vehicle, mass: float,
           coast: Straight | None) -> tuple[Straight | None, list[str]]:
    """(friction as found and the motor that belongs to it, notes)."""
    parts = [(d, n) for s, n in zip(series, sessions, strict=True) if (d := driven(s)) is not None]
    size: dict[str, int] = {}
    for one, name in parts:
        size[name] = size.get(name, 0) + len(one)
    small = [n for n, samples in size.items() if samples < MIN_SESSION]
    if len(small) == len(size):
        parts, small, size = [(s, "all") for s, _ in parts], [], {"all": 0}
    parts = [(s, n) for s, n in parts if n not in small]
    names = [n for n in size if n not in small]
    used = [s for s, _ in parts]
    free = _free(_count([s for s, n in zip(series, sessions, strict=True) if n not in small]))
    if not free:
        return None, []
    start = first_guess(used, base, mass)
    held = [i for i, n in enumerate(NAMES) if n not in free]
    start[held] = _of(base)[held]
    if coast is not None:
        start[:3] = coast.x[:3]
    friction = np.zeros((3, 3)) if coast is None else coast.covariance[:3, :3]
    fit, bands = fit_motor(used, np.array([names.index(n) for _, n in parts]), base, start, free,
                           friction, mass)
    if coast is not None:
        fit = replace(fit, free=(*coast.free, *fit.free),
                      independent=np.append(coast.independent[:3], fit.independent[3:]))
        if len(names) == 1 and TIMING[0] in free:
            fit = _timed(fit, used, base, mass)
    notes = [f"{n}: too little driven straight, left out" for n in small]
    notes += [] if bands is None else band_notes(names, bands)
    return replace(fit, sessions=len(names)), notes


def _timed(fit: Straight, series: Sequence[Speeds], base: Vehicle, mass: float) -> Straight:
    """The fit with the timing of one fit of everything, its errors over blocks.

    One session may coast little (the delay test hardly does): forces are then as
    uncertain as its friction, but when they begin does not hang on that.
    """
    whole = solve_straight(series, cut(series), base, fit.x, fit.free, mass)
    rows = [NAMES.index(n) for n in TIMING]
    x, covariance, independent = fit.x.copy(), fit.covariance.copy(), fit.independent.copy()
    x[rows], independent[rows] = whole.x[rows], whole.independent[rows]
    covariance[rows], covariance[:, rows] = 0.0, 0.0
    covariance[np.ix_(rows, rows)] = whole.covariance[np.ix_(rows, rows)]
    return replace(fit, x=x, covariance=covariance, independent=independent)


def _count(series: Sequence[Speeds]) -> Driving:
    throttle = [recent_throttle(s)[~s.tail] for s in series]
    v = np.concatenate([s.v[~s.tail] for s in series]) if series else np.zeros(0)
    tau = np.concatenate(throttle) if throttle else np.zeros(0)
    on = tau[tau > IDLE]
    return Driving(None, "", len(v), int((tau <= IDLE).sum()), len(on),
                   float(np.ptp(on)) if len(on) else 0.0, float(v.min(initial=np.inf)),
                   float(v.max(initial=0.0)),
                   sum(int((np.diff(t) != 0.0).sum()) for t in throttle),
                   float(np.mean([s.throttle.hold for s in series])) if series else 0.0)


def _free(c: Driving) -> tuple[str, ...]:
    """Of motor and timing."""
    if c.driven < MIN_DRIVEN:
        return ()
    return (MOTOR if c.level_span >= LEVEL else ("d", "e")) + (TIMING if c.changes else ())


def _of(base: Vehicle) -> FloatArray:
    f, m, t = base.friction, base.motor, base.delay
    return np.array([f.a, f.b, f.c, m.d, m.e, m.g, t.throttle_s, t.throttle_lag_s])
