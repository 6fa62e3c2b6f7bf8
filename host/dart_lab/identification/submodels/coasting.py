"""Friction from coasting alone, so that no error of the motor's form enters it.

1. Select the samples without throttle, and fit a, b, c to all of them.
2. Keep the samples at which the model of step 1 still moves, and fit again. The model decides and
   not the measured speed: a car that a chance disturbance pushes rolls longer, and would count
   more than one that is slowed down.
3. If b stops at its bound, the friction is sharper than speeds show: fix b, fit a and c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.prediction.windows import THROTTLE_MEMORY
from dart_lab.identification.submodels.guess import first_guess
from dart_lab.identification.submodels.speeds import Speeds
from dart_lab.identification.submodels.straight import STRAIGHT_NAMES, StraightFit, solve_straight
from dart_lab.identification.submodels.stretches import (
    MIN_STRETCH_SAMPLES,
    Stretches,
    cut_stretches,
)

FRICTION_NAMES = ("a", "b", "c")
# Far below any dead band: the motor has no force.
MAX_IDLE_THROTTLE = 0.05
MIN_COASTING_SAMPLES = 10
# The values of a session with fewer samples are too uncertain to be listed.
MIN_LISTED_SAMPLES = 30
# [m/s] A slower model differs from a car at rest by less than a count of the encoder.
MIN_MODEL_SPEED = 0.03
# b depends on the last 0.1 m/s, where an encoder's speed is old and chance holds the car. On
# simulated cars b was 5 % low, so that is its least error.
MIN_RELATIVE_STD_B = 0.06
# [s/m] Full dry friction from 0.1 m/s on, where speeds begin.
SHARP_FRICTION_B = 15.0


def recent_throttle(s: Speeds) -> FloatArray:
    """Return the largest throttle (n,) during the last 0.5 s before each sample."""
    stairs = s.throttle
    last = np.clip(np.searchsorted(stairs.t, s.t, side="right") - 1, 0, None)
    first = np.clip(np.searchsorted(stairs.t, s.t - THROTTLE_MEMORY, side="right") - 1, 0, None)
    out = stairs.value[last]
    for step in range(1, int((last - first).max(initial=0)) + 1):
        out = np.maximum(out, stairs.value[np.maximum(last - step, first)])
    return np.asarray(out)


def select_coasting(s: Speeds) -> Speeds | None:
    """Select the samples that coast, in runs of their own, with the tails after them."""
    found = select_runs(s, recent_throttle(s) <= MAX_IDLE_THROTTLE)
    # A tail without its run has no information.
    moving = {} if found is None else set(np.unique(found.run[~found.tail]).tolist())
    return None if found is None else select_runs(found, np.isin(found.run, list(moving)))


def select_driven(s: Speeds) -> Speeds | None:
    """Select the samples at which the motor acts, or did within the last 0.5 s."""
    return select_runs(s, (recent_throttle(s) > MAX_IDLE_THROTTLE) & ~s.tail)


def select_runs(s: Speeds, keep: BoolArray) -> Speeds | None:
    """Select the samples ``keep`` (n,); a run is split where samples between are missing."""
    rows = np.flatnonzero(keep)
    broken = np.append(True, (np.diff(rows) > 1) | (np.diff(s.run[rows]) != 0))[:len(rows)]
    run = np.cumsum(broken)
    label, count = np.unique(run, return_counts=True)
    long = np.isin(run, label[count >= MIN_STRETCH_SAMPLES])
    return s.select(rows[long], run[long]) if long.any() else None


def fit_coasting(series: Sequence[Speeds], sessions: Sequence[str], base: Vehicle, mass: float
                 ) -> tuple[StraightFit | None, list[str]]:
    """Fit a, b, c to all coasting samples; return (fit, notes), fit None if there are too few.

    sessions: name of each recording's session; the errors are no smaller than the differences
    between sessions. mass [kg].
    """
    parts = [(c, n) for s, n in zip(series, sessions, strict=True)
             if (c := select_coasting(s)) is not None]
    fit = _fit_friction([c for c, _ in parts], [n for _, n in parts], base, mass)
    if fit is None:
        return None, []
    notes = [] if "b" in fit.free else [
        "b is not identifiable, the dry friction is sharper than speeds show: held at "
        f"{fit.x[1]:g}"]
    names = dict.fromkeys(n for _, n in parts)
    if len(names) == 1:
        return fit, notes
    fit = replace(fit, sessions=len(names))
    notes.append(f"one fit of the coasting of {len(names)} sessions")
    for name in names:
        some = [c for c, n in parts if n == name]
        if sum(int((~c.tail).sum()) for c in some) < MIN_LISTED_SAMPLES:
            continue
        alone = _fit_friction(some, [name] * len(some), base, mass)
        if alone is not None:
            notes.append(f"{name} alone: " + ", ".join(
                f"{k} {alone.value(k):.3g} +- {alone.std(k):.2g}" for k in alone.free))
    return fit, notes


def _fit_friction(series: Sequence[Speeds], sessions: Sequence[str], base: Vehicle, mass: float
                  ) -> StraightFit | None:
    """Fit a, b, c to coasting, or a and c if the dry friction is too sharp to identify b."""
    if sum(map(len, series)) < MIN_COASTING_SAMPLES:
        return None
    scale = find_scale(base.body)
    s = cut_stretches(series)
    start = first_guess(series, base, mass)
    fit = solve_straight(series, s, base, start, FRICTION_NAMES, mass)
    used, owners = _trim_to_moving(series, sessions, s, s.v + fit.residual,
                                   MIN_MODEL_SPEED * scale.speed)
    if sum(map(len, used)) < MIN_COASTING_SAMPLES:
        return None
    s = cut_stretches(used)
    if len(np.unique(s.block)) < 2:
        return None  # the errors cannot be estimated from one block
    number = np.unique(owners, return_inverse=True)[1][s.series[s.stretch]]
    session = number if number.any() else None
    fit = solve_straight(used, s, base, fit.x, FRICTION_NAMES, mass, session)
    if "b" in fit.stopped:
        start = fit.x.copy()
        start[1] = max(base.friction.b, SHARP_FRICTION_B * scale.factor("s/m"))
        fit = solve_straight(used, s, base, start, ("a", "c"), mass, session)
    return _widen_b_error(fit)


def _widen_b_error(fit: StraightFit) -> StraightFit:
    """Add the least error of b to its variance."""
    if "b" not in fit.free:
        return fit
    i = STRAIGHT_NAMES.index("b")
    covariance = fit.covariance.copy()
    covariance[i, i] += (MIN_RELATIVE_STD_B * fit.x[i])**2
    return replace(fit, covariance=covariance)


def _trim_to_moving(series: Sequence[Speeds], sessions: Sequence[str], s: Stretches,
                    reading: FloatArray, least: float
                    ) -> tuple[list[Speeds], list[str]]:
    """Keep the samples at which the model's reading (n,) is above ``least`` [m/s].

    Returns the series that remain, and their sessions.
    """
    owner = s.series[s.stretch]
    used = []
    names = []
    for i, (one, name) in enumerate(zip(series, sessions, strict=True)):
        mine = owner == i
        fast = s.t[mine][reading[mine] >= least]
        kept = select_runs(one, np.isin(one.t, fast))
        if kept is not None:
            used.append(kept)
            names.append(name)
    return used, names
