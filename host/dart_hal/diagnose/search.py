"""Forward search: the effect that explains most, a full refit, again, and once back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dart_hal.types import FloatArray
from dart_hal.vehicle.effect import Effect
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.parameters import Vehicle

from .alike import alike
from .fit import Point, refit
from .noise import Noise, loss, measure
from .onboard import OnboardEvidence
from .residuals import Evidence
from .rows import BLOCK, Rows, rows_of
from .scan import Progress, Scan, Trial, scan
from .significance import best_of_nothing, p_value, threshold
from .space import Space, Timing

DEBUG = False
PASSES = 2  # the second with the sizes of the residuals of the first
TRIES = 4  # effects of one round that get a full refit
LEAST = 0.6  # of the small size of an effect: below that it is within what conventions do
FIRM = 1.0  # standard deviations by which held-out data must like an effect
RIVAL = 0.3  # of the gain of the winner
OWN_PART = 0.1  # of the gain must be where the effect enters


@dataclass(frozen=True, slots=True)
class Settings:
    """What a search may do: see ``diagnose``."""

    free: tuple[str, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    false_alarm: float = 0.01
    max_causes: int = 8
    jobs: int = 1
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Named:
    """An effect that was accepted: p and gain in its round, held-out gain, and its like.

    rivals: what gained enough in its round to be its like, had it been there.
    """

    effect: str
    p_value: float
    gain: float
    held_out: float
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
class Found:
    """base: the fitted base; point: with all effects named; ranking: trials of the first round.

    refit_loss: by how much the fit of the base lowered the loss.
    """

    base: Point
    point: Point
    noise: Noise
    named: tuple[Named, ...]
    rejected: tuple[Rejected, ...]
    ranking: tuple[Trial, ...]
    threshold: float
    refit_loss: float


class Search:
    """One search on the training evidence."""

    def __init__(self, evidence: Evidence, base: Vehicle, settings: Settings,
                 progress: Progress | None = None) -> None:
        self._evidence, self._settings, self._progress = evidence, settings, progress
        self._base = base
        self._done = 0.0

    def run(self) -> Found:
        """Search until nothing passes."""
        s = self._settings
        space = self._space(self._base)
        point, noise = self._settle(space, Timing())
        fixed = Space(self._base, ())
        refit_loss = refit(self._evidence, noise, fixed, fixed.point(point.timing)).loss() \
            - point.loss()
        base, first = point, tuple[Trial, ...]()
        named: list[Named] = []
        rejected: list[Rejected] = []
        limit = np.inf
        while True:
            trials = self._scan(point, noise)
            if not trials:  # all that may be named is named
                break
            accepted, rejected, limit = self._round(point, noise, trials)
            first = first or tuple(trials)
            if accepted is None or len(named) >= s.max_causes:
                break
            named.append(accepted[0])
            point, noise = self._settle(accepted[1].space, accepted[1].timing, accepted[1].x)
            point, noise, named = self._go_back(point, noise, named, limit)
        named = self._likes(point, noise, named)
        return Found(base, point, noise, tuple(named), tuple(rejected), first, limit, refit_loss)

    def fit(self, found: Found, effects: Sequence[str]) -> Point:
        """The base with some of the effects that were found, fitted anew."""
        p = found.point.vehicle
        if set(effects) == {a.name for a in p.effects} - {a.name for a in self._base.effects}:
            return found.point
        keep = {*effects, *(a.name for a in self._base.effects)}
        vehicle = replace(p, effects=tuple(a for a in p.effects if a.name in keep))
        space = self._space(vehicle)
        return refit(self._evidence, found.noise, space,
                     space.start(vehicle, found.point.timing))

    def _settle(self, space: Space, timing: Timing,
                x: FloatArray | None = None) -> tuple[Point, Noise]:
        """Fit and measure the residuals, until both suit each other."""
        x = space.point(timing) if x is None else x
        for _ in range(PASSES):
            vehicle, timing = space.split(x)
            noise = measure(self._evidence.residuals(vehicle, timing.late, timing.ahead),
                            self._evidence.blocks(BLOCK), self._evidence.overlap)
            point = refit(self._evidence, noise, space, x)
            x = point.x
        return point, noise

    def _scan(self, point: Point, noise: Noise) -> list[Trial]:
        def tell(share: float, name: str) -> None:
            if self._progress is not None:
                self._progress(self._done + 0.5 * share * (1.0 - self._done), name)

        trials = scan(self._evidence, noise, point, self._settings.names or None, tell,
                      self._settings.jobs)
        self._done += 0.5 * (1.0 - self._done)
        return trials

    def _rows(self, point: Point) -> Rows:
        timing = point.timing
        return rows_of(self._evidence, self._evidence.residuals(
            point.vehicle, timing.late, timing.ahead))

    def _round(self, point: Point, noise: Noise, trials: Sequence[Trial]
               ) -> tuple[tuple[Named, Point] | None, list[Rejected], float]:
        rows = self._rows(point)
        scan_here = Scan(self._evidence, noise, point)
        kinds = [rows.block]
        rest = point.after(trials[0].residual.astype(np.float64))[1]
        nothing = best_of_nothing(point, rest, trials, kinds, self._settings.seed)
        limit = threshold(nothing, self._settings.false_alarm)
        rejected = []
        accepted = None
        for i, trial in enumerate(trials):
            p = p_value(trial.gain, nothing)
            if accepted is not None:
                rejected.append(Rejected(trial.effect, p, trial.gain, np.nan, "gains less"))
                continue
            if trial.gain <= limit:
                rejected.append(Rejected(trial.effect, p, trial.gain, np.nan,
                                         "gains no more than nothing at all might"))
                continue
            if i >= TRIES:
                rejected.append(Rejected(trial.effect, p, trial.gain, np.nan,
                                         "gains less than others that failed"))
                continue
            candidate = self._with(point, noise, trial)
            held = held_out(point, candidate, rows)
            why = self._why_not(point, candidate, trial, rows, held, limit)
            if why:
                rejected.append(Rejected(trial.effect, p, trial.gain, held[0], why))
                if DEBUG: print('REJ',trial.effect,round(trial.gain),limit,held,why,flush=True)
                continue
            if DEBUG: print('ACC',trial.effect,trial.values,round(trial.gain),round(limit),held,round(point.loss()-candidate.loss()),flush=True)
            accepted = (Named(trial.effect, p, point.loss() - candidate.loss(), held[0],
                              alike(scan_here, trial, trials, rows),
                              tuple(t.effect for t in trials
                                    if 0.0 < RIVAL * trial.gain < t.gain and t is not trial)),
                        candidate)
        return accepted, rejected, limit

    def _with(self, point: Point, noise: Noise, trial: Trial) -> Point:
        """The full fit with one more effect, from its trial on."""
        vehicle = apply(point.vehicle, trial.effect, **trial.values)
        space = self._space(vehicle)
        return refit(self._evidence, noise, space, space.start(vehicle, point.timing))

    def _space(self, vehicle: Vehicle) -> Space:
        """Around the base, with the effects of a vehicle at their null."""
        p = self._base
        for a in vehicle.effects:
            if a.name not in {b.name for b in p.effects}:
                p = apply(p, a.name)
        return Space(p, self._settings.free, self._settings.known)

    def _why_not(self, point: Point, candidate: Point, trial: Trial, rows: Rows,
                 held: tuple[float, float], limit: float) -> str:
        effect = catalogue()[trial.effect]
        gain = point.loss() - candidate.loss()
        if gain <= limit:
            return "the full fit does not keep what the linear one promised"
        small = [abs(v - q.null) < LEAST * q.sizes[0]
                 for q, v in zip(effect.parameters, _values(candidate, effect), strict=True)]
        if all(small):
            return "smaller than what sampling and timing conventions can pretend"
        if held[0] <= 0.0 or held[0] < FIRM * held[1]:
            return "does not lower the loss of recordings left out of the fit"
        if not _where_it_enters(self._evidence, point, candidate, effect, rows, gain):
            return "gains only where it does not enter"
        return ""

    def _go_back(self, point: Point, noise: Noise, named: list[Named], limit: float
                 ) -> tuple[Point, Noise, list[Named]]:
        """Drop what the last one has made superfluous."""
        for one in list(named[:-1]):
            without = self._without(point, noise, one.effect)
            if without.loss() - point.loss() < limit:
                point, noise = self._settle(without.space, without.timing, without.x)
                named = [n for n in named if n.effect != one.effect]
        return point, noise, named

    def _without(self, point: Point, noise: Noise, name: str) -> Point:
        p = point.vehicle
        vehicle = replace(p, effects=tuple(a for a in p.effects if a.name != name))
        space = self._space(vehicle)
        return refit(self._evidence, noise, space, space.start(vehicle, point.timing))

    def _likes(self, point: Point, noise: Noise, named: list[Named]) -> list[Named]:
        """What each cause cannot be told from, beside all the others that were found."""
        if len(named) < 2:
            return named
        out = []
        for one in named:
            without = self._without(point, noise, one.effect)
            trials = scan(self._evidence, noise, without, (one.effect, *one.rivals))
            mine = next(t for t in trials if t.effect == one.effect)
            work = Scan(self._evidence, noise, without)
            out.append(replace(one, gain=without.loss() - point.loss(),
                               like=alike(work, mine, trials, self._rows(without))))
        return sorted(out, key=lambda n: -n.gain)


def held_out(before: Point, after: Point, rows: Rows) -> tuple[float, float]:
    """(gain on folds that the fit did not see, its standard error)."""
    gains = []
    for fold in range(int(rows.fold.max()) + 1):
        inside = rows.fold == fold
        losses = []
        for point in (before, after):
            move = point.follow(point.residual, ~inside)
            r = point.residual[inside] + point.jacobian[inside] @ move
            losses.append(float(point.worth[inside] @ loss(r)))
        gains.append(losses[0] - losses[1])
    n = len(gains)
    return float(np.sum(gains)), float(np.std(gains, ddof=1) * np.sqrt(n)) if n > 1 else np.inf


def _where_it_enters(evidence: Evidence, before: Point, after: Point, effect: Effect, rows: Rows,
                     gain: float) -> bool:
    """Causes in the car must show in its motion, those of a sensor in that sensor."""
    by_row = before.worth * loss(before.residual) - after.worth * loss(after.residual)
    part = rows.motion
    if effect.stage == "measurement" and "pose" not in effect.signals:
        part = ~part
    if isinstance(evidence, OnboardEvidence):  # encoder and gyro are predicted as the motion is
        part = evidence.entered(effect, rows.channel)
    return float(by_row[part].sum()) > OWN_PART * gain


def _values(point: Point, effect: Effect) -> tuple[float, ...]:
    values: tuple[float, ...] = next(a.values for a in point.vehicle.effects
                                     if a.name == effect.name)
    return values
