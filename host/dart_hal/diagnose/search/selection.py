"""One step of the search: which effect is accepted, if any, and why the others are not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import comb

import numpy as np

from dart_hal.process.jobs import each
from dart_hal.types import BoolArray, FloatArray
from dart_hal.vehicle.effect import Effect
from dart_hal.vehicle.effects import catalogue

from ..evidence.residuals import Evidence, only_read
from ..evidence.rows import RowLabels, rows_of
from ..policy import USUAL, NamingPolicy, Policy
from .confounders import confounders, directions
from .fit import Point
from .pairs import FitWith, one_of_a_pair
from .scan import Trial
from .significance import nothing_missing
from .size_search import scanned

TOO_SMALL = "smaller than what sampling and timing conventions can pretend"
NOT_HELD_OUT = "does not surely lower the loss of data left out from its size"
STEPS = 5  # of the fit of how far to go


@dataclass(frozen=True, slots=True)
class Settings:
    """What a search may do: see ``diagnose``.

    free: parameters of the base that move. refit: the effects of the base move as well.
    """

    free: tuple[str, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    false_alarm: float = 0.01
    max_causes: int = 12
    jobs: int = 1
    seed: int = 0
    policy: Policy = USUAL
    refit: bool = True


@dataclass(frozen=True, slots=True)
class Named:
    """An effect that was accepted: p and gain in its round, held-out gain, and its confounders.

    threshold: what it had to gain in that round.
    alternatives: what gained enough in its round to be a confounder beside all causes.
    """

    effect: str
    p_value: float
    gain: float
    held_out: float
    threshold: float
    confounders: tuple[str, ...]
    alternatives: tuple[str, ...] = ()


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


def explain(point: Point, trials: Sequence[Trial], fit_with: FitWith, policy: NamingPolicy
            ) -> dict[str, Point]:
    """Fit the trials that gain most until one keeps half of what it promised; by effect.

    A trial that leads astray, for what is linear ends early, must not be the last word on what the
    best effect would leave.
    """
    fits: dict[str, Point] = {}
    for trial in trials[:policy.explanations]:
        if trial.gain <= 0.0:
            break
        fits[trial.effect] = fit_with(point, trial)
        if point.loss() - fits[trial.effect].loss() > policy.keeps * trial.gain:
            break
    return fits


def least_lossy(point: Point, fits: Iterable[Point]) -> Point:
    """The fit with the smallest loss, or the point itself where none is better."""
    return min((point, *fits), key=lambda fit: fit.loss())


def select(evidence: Evidence, point: Point, trials: Sequence[Trial], fit_with: FitWith,
           settings: Settings, failed: dict[str, float],
           explanations: Mapping[str, Point] | None = None) -> Step:
    """The best effect that passes everything, and what else does apart from it.

    trials: largest gain first. failed: gain by name of what has been tried in vain
    in steps before; it is not tried again unless it gains more, and what fails here
    is added. explanations: see ``explain``, where that was done before.
    """
    policy, rows = settings.policy.naming, rows_at(evidence, point, settings.policy)
    fits = dict(explain(point, trials, fit_with, policy) if explanations is None else explanations)
    rest = least_lossy(point, fits.values()).residual
    nothing = nothing_missing(point, rest, trials, rows.block, settings.seed, policy.draws,
                              evidence.exact)
    limits = nothing.needed([t.effect for t in trials], settings.false_alarm)
    passed = [t for t in trials if t.gain > limits[t.effect]]
    again = [t for t in passed if t.gain > policy.try_again * failed.get(t.effect, 0.0)
             and not _too_small(catalogue()[t.effect], t.values, policy.tried_size)]
    close = [t for t in again if t.gain > policy.close * again[0].gain]
    fits |= fitted(partial(fit_with, point), [t for t in close if t.effect not in fits],
                   settings.jobs)
    direction = directions(point)
    order = sorted(passed, key=lambda t: policy.simpler * len(catalogue()[t.effect].parameters)
                   - (point.loss() - fits[t.effect].loss()) if t.effect in fits else 0.0)
    before = one_of_a_pair(point, again, trials, limits, fits, fit_with, policy.furthest)
    order.sort(key=lambda t: t is not before)
    accepted, rejected, failures = list[tuple[Named, Point]](), list[Rejected](), 0
    taken: list[FloatArray] = []
    for trial in (*order, *(t for t in trials if t not in passed)):
        limit = limits[trial.effect]
        p, held, why = nothing.p_value(trial.effect, trial.gain), HeldOut(), ""
        if trial.gain <= limit:
            why = "gains no more than nothing at all might"
        elif accepted and (trial.gain < policy.as_much * trials[0].gain or any(
                abs(float(direction(trial) @ d)) > policy.apart for d in taken)):
            why = f"gains less than {accepted[0][0].effect}"
        elif _too_small(catalogue()[trial.effect], trial.values, policy.tried_size):
            why = TOO_SMALL
        elif trial not in again:
            why = f"{NOT_HELD_OUT}, nor did it before"
        elif failures == policy.tries:
            why = "not tried: so many that gained more were tried in vain"
        else:
            candidate = fits[trial.effect] = fits.get(trial.effect) or fit_with(point, trial)
            held = held_out(point, candidate, rows, policy.furthest)
            why = _why_not(evidence, point, candidate, trial, rows, held, limit, settings.policy)
            if not why:
                one = Named(trial.effect, p, point.loss() - candidate.loss(), held.gain, limit,
                            confounders(point, trial, trials, rows, fits,
                                        settings.policy.confounders),
                            alternatives(trial, trials, settings.policy.confounders.alternative))
                accepted.append((one, candidate))
                taken.append(direction(trial))
            else:
                failed[trial.effect] = trial.gain
                failures += 1
        if why:
            rejected.append(Rejected(trial.effect, p, trial.gain, held.gain, why))
    return Step(tuple(accepted), tuple(rejected))


def fitted(fit_with: Callable[[Trial], Point], trials: Sequence[Trial], jobs: int
           ) -> dict[str, Point]:
    """The full fit of each trial, by effect."""
    return dict(each(partial(_fit, fit_with), trials, jobs))


def _fit(fit_with: Callable[[Trial], Point], trial: Trial) -> tuple[str, Point]:
    return trial.effect, fit_with(trial)


def rows_at(evidence: Evidence, point: Point, policy: Policy) -> RowLabels:
    """What belongs to what, of the residuals of a point."""
    return rows_of(evidence, evidence.residuals(point.vehicle, point.timing), policy.blocks)


def alternatives(trial: Trial, trials: Sequence[Trial], share: float) -> tuple[str, ...]:
    """What gains enough beside an effect to be its confounder, had it been there."""
    return tuple(t.effect for t in trials
                 if t is not trial and t.gain > max(0.0, share * trial.gain))


def _why_not(evidence: Evidence, point: Point, candidate: Point, trial: Trial, rows: RowLabels,
             held: HeldOut, limit: float, policy: Policy) -> str:
    effect, p = catalogue()[trial.effect], policy.naming
    gain = point.loss() - candidate.loss()
    if gain <= limit:
        return "the full fit does not keep what the linear one promised"
    if _too_small(effect, _values(candidate, effect), p.least_size):
        return TOO_SMALL
    if doubt := held.doubt(int(rows.recording.max()) + 1 >= policy.blocks.units, p):
        return doubt
    if only_read(effect) and (_axes_disagree(candidate, effect, rows, p.axis_knows)
                              > max(p.axes, p.axes_share * gain)):
        return "one axis of the sensor says another size of it than the other"
    by_row = (point.weight * point.noise.loss(point.residual)
              - candidate.weight * candidate.noise.loss(candidate.residual))
    if float(by_row[evidence.entered(effect, rows.channel)].sum()) <= p.own_part * gain:
        return "gains only where it does not enter"
    return ""


def _too_small(effect: Effect, values: Mapping[str, float], share: float) -> bool:
    """Whether every parameter that is an effect of its own is below a share of its small size."""
    return all(abs(values.get(q.name, q.null) - q.null) < share * q.sizes[0]
               for q in scanned(effect))


def _axes_disagree(candidate: Point, effect: Effect, rows: RowLabels, least: float) -> float:
    """How much the loss would drop if each axis of a sensor had a size of its own.

    What smoothing leaves of a turn looks like an effect, but not alike on both axes.
    least: share of all that is known of the size, from where on an axis is asked.
    """
    sensors, most = rows.channel < 0, 0.0
    channel = -1 - rows.channel[sensors]
    for q in effect.parameters:
        slope = candidate.jacobian[sensors, candidate.space.names.index(f"{effect.name}.{q.name}")]
        weight = candidate.irls_weight[sensors]
        pull = np.bincount(channel, weight * candidate.residual[sensors] * slope)
        normal = np.bincount(channel, weight * slope**2)
        knows = normal > least * normal.sum()
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

    def doubt(self, many: bool, policy: NamingPolicy) -> str:
        """Why they do not surely like it, if they do not; many: a fold is one of many recordings.

        Then a few that gain much more than the others are no doubt, but a single one is.
        """
        n = len(self.gains)
        std = float(np.std(self.gains, ddof=1) * np.sqrt(n)) if n > 1 else np.inf
        like = sum(g > 0.0 for g in self.gains)
        chance = sum(comb(n, k) for k in range(like, n + 1)) / 2.0**n
        if self.gain <= 0.0 or not (self.gain >= policy.firm * std
                                    or (many and chance <= policy.chance)):
            return NOT_HELD_OUT
        if many and self.gain - max(self.gains) <= 0.0:
            return "lowers the loss of a single recording only, of those left out from its size"
        return ""


def held_out(before: Point, after: Point, rows: RowLabels, furthest: float) -> HeldOut:
    """What data left out, fold by fold, gain from one point to another.

        l_f = argmin over l in [0, furthest] of sum_(i not in f) w_i rho(r_i + l d_i)
        g_f = sum_(i in f) w_i (rho(r_i) - rho(r_i + l_f d_i))
        kept if G = sum_f g_f > 0 and G >= firm sqrt(n) std(g), see ``HeldOut.doubt``

    Args:
        before, after: fits without and with the effect; d = after - before (N,) of residuals.
        rows: folds f of the N rows.
        furthest: bound of l.

    Only how far to go is estimated anew. All else that is free stays where all data have it:
    without one of few recordings it would leave for where nothing was driven.
    """
    r, d = before.residual, after.residual - before.residual
    gains = []
    for fold in range(int(rows.fold.max()) + 1):
        inside = rows.fold == fold
        share = _how_far(before, d, ~inside, furthest)
        gains.append(float(before.weight[inside] @ (
            before.noise.loss(r[inside]) - before.noise.loss(r[inside] + share * d[inside]))))
    return HeldOut(tuple(gains))


def _how_far(before: Point, d: FloatArray, rows: BoolArray, furthest: float) -> float:
    """Share of a change d (N,) that lowers the loss of some rows most, 0 to ``furthest``."""
    r, d, weight, share = before.residual[rows], d[rows], before.weight[rows], 1.0
    for _ in range(STEPS):
        w = weight * before.noise.robust_weight(r + share * d)
        share = float(np.clip(-(w * d) @ r / max(float((w * d) @ d), 1e-12), 0.0, furthest))
    return share


def _values(point: Point, effect: Effect) -> dict[str, float]:
    values = next(a.values for a in point.vehicle.effects if a.name == effect.name)
    return {q.name: v for q, v in zip(effect.parameters, values, strict=True)}
