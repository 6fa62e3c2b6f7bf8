"""Fit of friction, motor and throttle timing to straight driving.

1. Select straight driving in all recordings, and count what it excites.
2. Fit the friction to coasting alone.
3. Fit the motor to driven stretches, with that friction and its errors. In a common fit the
   friction would absorb the errors of the motor's form.
4. Add the error of the mass to all forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.calibration.sessions import sessions_of
from dart_hal.core.types import FloatArray
from dart_hal.recording.check.uses import MIN_STRAIGHT_S
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import Vehicle
from dart_lab.identification.fit import FittedParameter
from dart_lab.identification.submodels.coasting import (
    MAX_IDLE_THROTTLE,
    fit_coasting,
    recent_throttle,
    select_coasting,
    select_driven,
)
from dart_lab.identification.submodels.guess import first_guess
from dart_lab.identification.submodels.motor_fit import band_notes, fit_motor
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import ENCODER_WINDOW, Speeds, read_speeds
from dart_lab.identification.submodels.straight import STRAIGHT_NAMES, StraightFit, solve_straight
from dart_lab.identification.submodels.stretches import cut_stretches

MIN_STRAIGHT_SAMPLES = round(MIN_STRAIGHT_S / ENCODER_WINDOW)
# Driven samples of a session with several sessions; smaller sessions are left out.
MIN_SESSION_DRIVEN = 30
# Driven samples that a fit of the motor needs.
MIN_DRIVEN_SAMPLES = 30
# Span of the throttle that identifies the dead band g; closer levels count as one.
MIN_LEVEL_SPAN = 0.03
# Standard error over value of a friction that is the base's: it may be that of another car. Of
# simulated cars of 1 to 4 kg it was 0.6 to 2.5 times the base's.
UNKNOWN_FRICTION_SHARE = 1.0
MOTOR_NAMES = ("d", "e", "g")
TIMING_NAMES = ("throttle_s", "throttle_lag_s")


@dataclass(frozen=True, slots=True)
class StraightDriving:
    """Fit of straight driving, or None with the reason; and counts of the samples.

    fit: friction, motor and timing with all covariances; its residual is that of driven motion.
    coast: fit of the coasting. level_span: of the throttle while driven. slowest, fastest [m/s].
    changes: number of throttle steps. hold [s]: mean delay of the logged throttle.
    """

    fit: StraightFit | None
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
    coast: StraightFit | None = None
    coast_notes: tuple[str, ...] = ()


def fit_straight_driving(recordings: Sequence[Recording], reference: Reference | None,
                         base: Vehicle,
                         mass: FittedParameter | None, ledger: Ledger,
                         only_friction: bool = False) -> StraightDriving:
    """Select straight driving, choose the free parameters, fit coasting and driven stretches."""
    series: list[Speeds] = []
    sessions: list[str] = []
    for recording, session in zip(recordings, sessions_of(recordings), strict=True):
        one = read_speeds(recording, reference, ledger)
        if one is not None and only_friction:
            one = select_coasting(one)
        if one is not None:
            series.append(one)
            sessions.append(session)
    everything = _count_samples(series)
    kilograms, mass_std = (base.body.mass, 0.0) if mass is None else (mass.value, mass.std)
    if everything.samples < MIN_STRAIGHT_SAMPLES:
        what = "coasting" if only_friction else "straight driving"
        return replace(everything,
                       why_not=f"{everything.samples * ENCODER_WINDOW:.1f} s of {what}, at "
                       f"least {MIN_STRAIGHT_SAMPLES * ENCODER_WINDOW:.0f} s needed")
    coast, coast_notes = fit_coasting(series, sessions, base, kilograms)
    fit, notes = _fit_driven(series, sessions, base, kilograms, coast)
    found = fit or coast
    if found is None:
        return replace(everything, why_not="neither coasting nor a driven stretch long enough")
    return replace(
        everything, fit=found.with_mass(kilograms, mass_std), notes=tuple(notes),
        coast=None if coast is None else coast.with_mass(kilograms, mass_std),
        coast_notes=tuple(coast_notes))


def _fit_driven(series: Sequence[Speeds], sessions: Sequence[str], base: Vehicle, mass: float,
                coast: StraightFit | None) -> tuple[StraightFit | None, list[str]]:
    """Fit the motor to driven stretches with the friction of ``coast``; return (fit, notes)."""
    parts = [(d, n) for s, n in zip(series, sessions, strict=True)
             if (d := select_driven(s)) is not None]
    # Sessions with few samples are left out; if all have few, they count as one session.
    size: dict[str, int] = {}
    for one, name in parts:
        size[name] = size.get(name, 0) + len(one)
    small = [n for n, samples in size.items() if samples < MIN_SESSION_DRIVEN]
    if len(small) == len(size):
        parts = [(s, "all") for s, _ in parts]
        small = []
        size = {"all": 0}
    parts = [(s, n) for s, n in parts if n not in small]
    names = [n for n in size if n not in small]
    used = [s for s, _ in parts]
    free = _choose_free(_count_samples([s for s, n in zip(series, sessions, strict=True)
                                        if n not in small]))
    if not free:
        return None, []
    # Start: the fitted friction, a guess of what is free, the base's values of all others.
    start = first_guess(used, base, mass)
    fixed = [i for i, n in enumerate(STRAIGHT_NAMES) if n not in free]
    start[fixed] = _base_values(base)[fixed]
    if coast is not None:
        start[:3] = coast.x[:3]
    friction = (np.diag((UNKNOWN_FRICTION_SHARE * start[:3])**2) if coast is None
                else coast.covariance[:3, :3])
    fit, bands = fit_motor(used, np.array([names.index(n) for _, n in parts]), base, start, free,
                           friction, mass)
    if coast is not None:
        fit = replace(fit, free=(*coast.free, *fit.free),
                      independent=np.append(coast.independent[:3], fit.independent[3:]))
        if len(names) == 1 and TIMING_NAMES[0] in free:
            fit = _replace_timing(fit, used, base, mass)
    notes = [f"{n}: too little driven straight, left out" for n in small]
    notes += [] if bands is None else band_notes(names, bands)
    return replace(fit, sessions=len(names)), notes


def _replace_timing(fit: StraightFit, series: Sequence[Speeds], base: Vehicle,
                    mass: float) -> StraightFit:
    """Replace the timing by that of a fit of all parameters, with its errors over blocks.

    One session may coast little (the delay test hardly does). The forces are then as uncertain
    as its friction, but the time at which they begin does not depend on it.
    """
    whole = solve_straight(series, cut_stretches(series), base, fit.x, fit.free, mass)
    rows = [STRAIGHT_NAMES.index(n) for n in TIMING_NAMES]
    x = fit.x.copy()
    covariance = fit.covariance.copy()
    independent = fit.independent.copy()
    x[rows] = whole.x[rows]
    independent[rows] = whole.independent[rows]
    covariance[rows] = 0.0
    covariance[:, rows] = 0.0
    covariance[np.ix_(rows, rows)] = whole.covariance[np.ix_(rows, rows)]
    return replace(fit, x=x, covariance=covariance, independent=independent)


def _count_samples(series: Sequence[Speeds]) -> StraightDriving:
    throttle = [recent_throttle(s)[~s.tail] for s in series]
    v = np.concatenate([s.v[~s.tail] for s in series]) if series else np.zeros(0)
    tau = np.concatenate(throttle) if throttle else np.zeros(0)
    on = tau[tau > MAX_IDLE_THROTTLE]
    return StraightDriving(None, "", len(v), int((tau <= MAX_IDLE_THROTTLE).sum()), len(on),
                           float(np.ptp(on)) if len(on) else 0.0, float(v.min(initial=np.inf)),
                           float(v.max(initial=0.0)),
                           sum(int((np.diff(t) != 0.0).sum()) for t in throttle),
                           float(np.mean([s.throttle.hold for s in series])) if series else 0.0)


def _choose_free(c: StraightDriving) -> tuple[str, ...]:
    """Choose the free parameters of motor and timing."""
    if c.driven < MIN_DRIVEN_SAMPLES:
        return ()
    motor = MOTOR_NAMES if c.level_span >= MIN_LEVEL_SPAN else ("d", "e")
    return motor + (TIMING_NAMES if c.changes else ())


def _base_values(base: Vehicle) -> FloatArray:
    f = base.friction
    m = base.duty_motor
    t = base.delay
    return np.array([f.a, f.b, f.c, m.d, m.e, m.g, t.throttle_s, t.throttle_lag_s])
