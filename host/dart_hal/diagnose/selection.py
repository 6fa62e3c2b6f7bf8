"""One step of the search: which effect is accepted, if any, and why the others are not."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import comb

import numpy as np

from dart_hal.types import FloatArray
from dart_hal.vehicle.effect import Effect
from dart_hal.vehicle.effects import catalogue

from .alike import alike, directions
from .fit import Point
from .jobs import each
from .noise import loss, weight
from .residuals import Evidence, only_read
from .rows import Rows, rows_of
from .scan import Trial, scanned
from .significance import nothing_missing

TRIES = 5  # effects of one round that may fail after a full refit
APART, AS_MUCH = 0.1, 0.5
"""Cosine, and share of the largest gain: causes that hardly touch the same residuals, and gain as
much, are accepted in one round."""
CLOSE = 0.7  # of the largest gain: the full fit decides between these
LEAST, NOT_TRIED = 0.8, 0.4
"""Of the small size of an effect: below that it is within what conventions do, and what is found
even smaller before a full fit is not tried."""
TOO_SMALL = "smaller than what sampling and timing conventions can pretend"
DISLIKED = "does not surely lower the loss of data left out from its size"
FIRM, CHANCE = 0.84, 0.05
"""Standard errors by which data left out must like an effect, at odds of four to one; or how
seldom chance alone would make as many recordings like it: a few that gain much more than the
others are no doubt."""
MANY = 6  # recordings from which on they are the unit: no single one may be all the gain
FURTHEST, STEPS = 2.0, 5  # of the way of all data, for those that are left; steps to find it
MORE = 1.5  # times what it gained when it failed
PER_PARAMETER = 2.0  # of the loss; of two that gain the same, the simpler is the cause
RIVAL = 0.3  # of the gain of the winner
OWN_PART = 0.1  # of the gain must be where the effect enters
AT_ODDS, OF_GAIN, KNOWS = 4.0, 0.05, 0.02
"""Loss that a size for each axis of a sensor may gain (2 standard deviations), at least that share
of what the effect gains; and share of all that is known of its size from where on an axis is
asked. What smoothing leaves of a turn looks like an effect, but not alike on both axes."""
FitWith = Callable[[Trial], Point]


@dataclass(frozen=True, slots=True)
class Settings:
    """What a search may do: see ``diagnose``."""

    free: tuple[str, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    false_alarm: float = 0.01
    max_causes: int = 12
    jobs: int = 1
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Named:
    """An effect that was accepted: p and gain in its round, held-out gain, and its like.

    threshold: what it had to gain in that round.
    rivals: what gained enough in its round to be its like, had it been there.
    """

    effect: str
    p_value: float
    gain: float
    held_out: float
    threshold: float
    like: tuple[str, ...]
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Rejected:
    """An effect of the last round that was not accepted."""

    effect: str
    p_value: float
    gain: float
    held_out: float
    why: str


@dataclass(frozen=True, slots=True)
class Step:
    """accepted: effects and the fit with each."""

    accepted: tuple[tuple[Named, Point], ...]
    rejected: tuple[Rejected, ...]


def select(evidence: Evidence, point: Point, trials: Sequence[Trial],
           fit_with: FitWith, settings: Settings, failed: dict[str, float]) -> Step:
    """The best effect that passes everything, and what else does apart from it.

    trials: largest gain first. failed: gain by name of what has been tried in vain
    in steps before; it is not tried again unless it gains more, and what fails here
    is added.
    """
    rows = rows_at(evidence, point)
    first = fit_with(trials[0])
    rest = first.residual if first.loss() < point.loss() else point.residual
    nothing = nothing_missing(point, rest, trials, rows.block, settings.seed, evidence.exact)
    limits = nothing.needed([t.effect for t in trials], settings.false_alarm)
    passed = [t for t in trials if t.gain > limits[t.effect]]
    again = [t for t in passed if t.gain > MORE * failed.get(t.effect, 0.0)
             and not _too_small(catalogue()[t.effect], t.values, NOT_TRIED)]
    close = [t for t in again if t.gain > CLOSE * again[0].gain]
    fits = fitted(fit_with, [t for t in close if t is not trials[0]], settings.jobs)
    if any(t is trials[0] for t in close):
        fits[trials[0].effect] = first
    direction = directions(point)
    order = sorted(passed, key=lambda t: PER_PARAMETER * len(catalogue()[t.effect].parameters)
                   - (point.loss() - fits[t.effect].loss()) if t.effect in fits else 0.0)
    accepted, rejected, failures = list[tuple[Named, Point]](), list[Rejected](), 0
    taken: list[FloatArray] = []
    for trial in (*order, *(t for t in trials if t not in passed)):
        limit = limits[trial.effect]
        p, held, why = nothing.p_value(trial.effect, trial.gain), HeldOut(), ""
        if trial.gain <= limit:
            why = "gains no more than nothing at all might"
        elif accepted and (trial.gain < AS_MUCH * trials[0].gain or any(
                abs(float(direction(trial) @ d)) > APART for d in taken)):
            why = f"gains less than {accepted[0][0].effect}"
        elif _too_small(catalogue()[trial.effect], trial.values, NOT_TRIED):
            why = TOO_SMALL
        elif trial not in again:
            why = f"{DISLIKED}, nor did it before"
        elif failures == TRIES:
            why = "not tried: so many that gained more were tried in vain"
        else:
            candidate = fits[trial.effect] = fits.get(trial.effect) or fit_with(trial)
            held = held_out(point, candidate, rows)
            why = _why_not(evidence, point, candidate, trial, rows, held, limit)
            if not why:
                one = Named(trial.effect, p, point.loss() - candidate.loss(), held.gain, limit,
                            alike(point, trial, trials, rows, fits), rivals(trial, trials))
                accepted.append((one, candidate))
                taken.append(direction(trial))
            else:
                failed[trial.effect] = trial.gain
                failures += 1
        if why:
            rejected.append(Rejected(trial.effect, p, trial.gain, held.gain, why))
    return Step(tuple(accepted), tuple(rejected))


def fitted(fit_with: FitWith, trials: Sequence[Trial], jobs: int) -> dict[str, Point]:
    """The full fit of each trial, by effect."""
    return dict(each(partial(_fit, fit_with), trials, jobs))


def _fit(fit_with: FitWith, trial: Trial) -> tuple[str, Point]:
    return trial.effect, fit_with(trial)


def rows_at(evidence: Evidence, point: Point) -> Rows:
    """What belongs to what, of the residuals of a point."""
    return rows_of(evidence, evidence.residuals(point.vehicle, point.timing))


def rivals(trial: Trial, trials: Sequence[Trial]) -> tuple[str, ...]:
    """What gains enough beside an effect to be its like, had it been there."""
    return tuple(t.effect for t in trials
                 if t is not trial and t.gain > max(0.0, RIVAL * trial.gain))


def _why_not(evidence: Evidence, point: Point, candidate: Point, trial: Trial, rows: Rows,
             held: HeldOut, limit: float) -> str:
    effect = catalogue()[trial.effect]
    gain = point.loss() - candidate.loss()
    if gain <= limit:
        return "the full fit does not keep what the linear one promised"
    if _too_small(effect, _values(candidate, effect), LEAST):
        return TOO_SMALL
    if doubt := held.doubt(int(rows.recording.max()) + 1):
        return doubt
    if only_read(effect) and _at_odds(candidate, effect, rows) > max(AT_ODDS, OF_GAIN * gain):
        return "one axis of the sensor says another size of it than the other"
    by_row = point.worth * loss(point.residual) - candidate.worth * loss(candidate.residual)
    if float(by_row[evidence.entered(effect, rows.channel)].sum()) <= OWN_PART * gain:
        return "gains only where it does not enter"
    return ""


def _too_small(effect: Effect, values: Mapping[str, float], share: float) -> bool:
    """Whether every parameter that is an effect of its own is below a share of its small size."""
    return all(abs(values.get(q.name, q.null) - q.null) < share * q.sizes[0]
               for q in scanned(effect))


def _at_odds(candidate: Point, effect: Effect, rows: Rows) -> float:
    """How much the loss would drop if each axis of a sensor had a size of its own."""
    told, most = rows.channel < 0, 0.0
    channel = -1 - rows.channel[told]
    for q in effect.parameters:
        slope = candidate.jacobian[told, candidate.space.names.index(f"{effect.name}.{q.name}")]
        weight = candidate.weights[told]
        pull = np.bincount(channel, weight * candidate.residual[told] * slope)
        normal = np.bincount(channel, weight * slope**2)
        knows = normal > KNOWS * normal.sum()
        most = max(most, float((pull[knows]**2 / normal[knows]).sum()))
    return most


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Gain on each fold, at the size that the others give."""

    gains: tuple[float, ...] = ()

    @property
    def gain(self) -> float:
        """On all of them; NaN without any."""
        return sum(self.gains) if self.gains else np.nan

    def doubt(self, recordings: int) -> str:
        """Why they do not surely like it, if they do not; from MANY on a fold is a recording."""
        n, many = len(self.gains), recordings >= MANY
        std = float(np.std(self.gains, ddof=1) * np.sqrt(n)) if n > 1 else np.inf
        like = sum(g > 0.0 for g in self.gains)
        chance = sum(comb(n, k) for k in range(like, n + 1)) / 2.0**n
        if self.gain <= 0.0 or not (self.gain >= FIRM * std or (many and chance <= CHANCE)):
            return DISLIKED
        if many and self.gain - max(self.gains) <= 0.0:
            return "lowers the loss of a single recording only, of those left out from its size"
        return ""


def held_out(before: Point, after: Point, rows: Rows) -> HeldOut:
    """How data left out, fold by fold, like what came between two points.

    How far to go from the one to the other is said by the other folds. All else that
    is free stays where all data have it: without one of few recordings it would
    leave for where nothing was driven, and what that does there would be the answer.
    """
    r, way = before.residual, after.residual - before.residual
    gains = []
    for fold in range(int(rows.fold.max()) + 1):
        inside = rows.fold == fold
        share = _how_far(r[~inside], way[~inside], before.worth[~inside])
        gains.append(float(before.worth[inside] @ (loss(r[inside])
                                                   - loss(r[inside] + share * way[inside]))))
    return HeldOut(tuple(gains))


def _how_far(r: FloatArray, way: FloatArray, worth: FloatArray) -> float:
    """Share of the way that lowers the loss of some rows most, 0 to FURTHEST."""
    share = 1.0
    for _ in range(STEPS):
        w = worth * weight(r + share * way)
        share = float(np.clip(-(w * way) @ r / max(float((w * way) @ way), 1e-12), 0.0, FURTHEST))
    return share


def _values(point: Point, effect: Effect) -> dict[str, float]:
    values = next(a.values for a in point.vehicle.effects if a.name == effect.name)
    return {q.name: v for q, v in zip(effect.parameters, values, strict=True)}
