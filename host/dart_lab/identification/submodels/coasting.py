"""Friction out of coasting alone: what the motor's form does not explain cannot leak into it.

Coasting ends where the model, not the car, all but stands (two passes): a car
pushed by a chance disturbance rolls longer, and to take all it shows while it
rolls would count it for more than one that is held back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle import Vehicle
from dart_lab.identification.submodels.guess import first_guess
from dart_lab.identification.submodels.speeds import SETTLE, Speeds
from dart_lab.identification.submodels.straight import NAMES, Straight, solve_straight
from dart_lab.identification.submodels.stretches import SHORTEST, Stretches, cut

FRICTION = ("a", "b", "c")
IDLE = 0.05  # of throttle: far below any dead band, no force
MIN_SAMPLES = 10
MIN_SESSION = 30  # samples; of fewer, the values of a session alone are too uncertain to be listed
STANDSTILL = 0.03  # m/s; a model as slow differs from a car that stands by less than a count
MIN_RELATIVE_STD_B = 0.06
"""Of b: it hangs on the last tenth of a metre per second, where an encoder's speed is old and the
car is held by chance; on simulated cars b came out 5 % low, so that is its least error."""
SHARP = 15.0  # s/m: full dry friction from 0.1 m/s on, where speeds begin


def recent_throttle(s: Speeds) -> FloatArray:
    """Largest throttle (n,) held during the last 0.5 s before each sample."""
    stairs = s.throttle
    last = np.clip(np.searchsorted(stairs.t, s.t, side="right") - 1, 0, None)
    first = np.clip(np.searchsorted(stairs.t, s.t - SETTLE, side="right") - 1, 0, None)
    out = stairs.value[last]
    for step in range(1, int((last - first).max(initial=0)) + 1):
        out = np.maximum(out, stairs.value[np.maximum(last - step, first)])
    return np.asarray(out)


def coasting(s: Speeds) -> Speeds | None:
    """The samples that coast, in runs of their own, with the tails after them."""
    found = part(s, recent_throttle(s) <= IDLE)
    # a tail without what it is the tail of says nothing
    moving = {} if found is None else set(np.unique(found.run[~found.tail]).tolist())
    return None if found is None else part(found, np.isin(found.run, list(moving)))


def driven(s: Speeds) -> Speeds | None:
    """The samples on which the motor acts, or did within the last 0.5 s."""
    return part(s, (recent_throttle(s) > IDLE) & ~s.tail)


def part(s: Speeds, keep: BoolArray) -> Speeds | None:
    """The samples ``keep`` (n,), in runs broken where some between them are missing."""
    rows = np.flatnonzero(keep)
    broken = np.append(True, (np.diff(rows) > 1) | (np.diff(s.run[rows]) != 0))[:len(rows)]
    run = np.cumsum(broken)
    label, count = np.unique(run, return_counts=True)
    long = np.isin(run, label[count >= SHORTEST])
    return s.only(rows[long], run[long]) if long.any() else None


def fit_coasting(series: Sequence[Speeds], sessions: Sequence[str], base: Vehicle, mass: float
                 ) -> tuple[Straight | None, list[str]]:
    """(one fit of a, b, c to all that coasts, notes); None where that is too little.

    sessions: of each recording; the errors are no smaller than what the sessions
    differ by. mass [kg].
    """
    parts = [(c, n) for s, n in zip(series, sessions, strict=True)
             if (c := coasting(s)) is not None]
    fit = _fit([c for c, _ in parts], [n for _, n in parts], base, mass)
    if fit is None:
        return None, []
    notes = [] if "b" in fit.free else [
        f"b cannot be told, the dry friction is sharper than speeds show: held at {fit.x[1]:g}"]
    names = dict.fromkeys(n for _, n in parts)
    if len(names) == 1:
        return fit, notes
    fit = replace(fit, sessions=len(names))
    notes.append(f"one fit of the coasting of {len(names)} sessions")
    for name in names:
        some = [c for c, n in parts if n == name]
        if sum(int((~c.tail).sum()) for c in some) < MIN_SESSION:
            continue
        alone = _fit(some, [name] * len(some), base, mass)
        if alone is not None:
            notes.append(f"{name} alone: " + ", ".join(
                f"{k} {alone.value(k):.3g} +- {alone.std(k):.2g}" for k in alone.free))
    return fit, notes


def _fit(series: Sequence[Speeds], sessions: Sequence[str], base: Vehicle, mass: float
         ) -> Straight | None:
    """Fit of a, b, c to coasting; a, c where the dry friction is too sharp for b to be told."""
    if sum(map(len, series)) < MIN_SAMPLES:
        return None
    s = cut(series)
    start = first_guess(series, base, mass)
    fit = solve_straight(series, s, base, start, FRICTION, mass)
    used, owners = _trimmed(series, sessions, s, s.v + fit.residual)
    if sum(map(len, used)) < MIN_SAMPLES:
        return None
    s = cut(used)
    if len(np.unique(s.block)) < 2:
        return None  # errors would not be known
    number = np.unique(owners, return_inverse=True)[1][s.series[s.stretch]]
    session = number if number.any() else None
    fit = solve_straight(used, s, base, fit.x, FRICTION, mass, session)
    if "b" in fit.stopped:
        start = fit.x.copy()
        start[1] = max(base.friction.b, SHARP)
        fit = solve_straight(used, s, base, start, ("a", "c"), mass, session)
    return _blunted(fit)


def _blunted(fit: Straight) -> Straight:
    """The same with the least error of b."""
    if "b" not in fit.free:
        return fit
    i, covariance = NAMES.index("b"), fit.covariance.copy()
    covariance[i, i] += (MIN_RELATIVE_STD_B * fit.x[i])**2
    return replace(fit, covariance=covariance)


def _trimmed(series: Sequence[Speeds], sessions: Sequence[str], s: Stretches, reading: FloatArray
             ) -> tuple[list[Speeds], list[str]]:
    """Only what the model reads (n,) moving, and its sessions."""
    owner = s.series[s.stretch]
    used, names = [], []
    for i, (one, name) in enumerate(zip(series, sessions, strict=True)):
        mine = owner == i
        fast = s.t[mine][reading[mine] >= STANDSTILL]
        kept = part(one, np.isin(one.t, fast))
        if kept is not None:
            used.append(kept)
            names.append(name)
    return used, names
