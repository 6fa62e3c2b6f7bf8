"""Which names are shown: each with its grade, and what is only possible left out of the model."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..evidence.noise import Noise
from ..evidence.residuals import Evidence
from ..policy import Policy
from ..result import Constancy, Cost, Gained
from ..search.fit import Point
from ..search.forward import Search
from .bag import grades, sizes
from .constancy import constancy
from .secants import Secants, secants

NOT_SURE = "too few of the data left out from its size want it beside the others"
NO_GAIN = "it does not surely lower the errors on recordings that no fit has seen"


@dataclass(frozen=True, slots=True)
class Grade:
    """Share of draws in which data left out from its size want a name.

    sizes: by recording, (size relative to the fitted one, its standard error).
    """

    probability: float
    sizes: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Shown:
    """Names in the order of their gain, the fits with one more each, and what was left out."""

    names: tuple[str, ...]
    points: tuple[Point, ...]
    grades: Mapping[str, Grade]
    judged: Mapping[str, Judged]
    constancy: Mapping[str, Constancy]
    left_out: Mapping[str, LeftOut]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A name that is not shown: its probability, and why."""

    probability: float
    why: str


class Judged(NamedTuple):
    """cost: all errors without the name over those with it; gain: in the channel where it shows."""

    cost: Cost
    gain: Gained


@dataclass(frozen=True, slots=True)
class Grading:
    """What it takes to grade: the search that made the fits, and the training evidence.

    costs(fit, without): errors on recordings that no fit has seen without each name, over those of
    the fit with all; without: the fits without one name each. gains(names, points): what each name
    gains there in the channel where it shows, by the fit before it and that with it.
    impossible(fit, name): why no car has the size that a name has there, or "".
    """

    search: Search
    evidence: Evidence
    policy: Policy
    seed: int
    costs: Callable[[Point, Mapping[str, Point]], Mapping[str, Cost]]
    gains: Callable[[Sequence[str], Sequence[Point]], Sequence[Gained]]
    impossible: Callable[[Point, str], str]


def shown(with_: Grading, points: Sequence[Point], at: Point, noise: Noise,
          names: Sequence[str]) -> Shown:
    """Leave out the name of the lowest grade until all that are left are sure enough.

    Possible ones that went come back, the one that gains most first, where all are sure enough
    with it: what made them unsure may have gone after them. Then go, one at a time, those whose
    size no car has, and the one that is missed least, until errors on recordings that no fit has
    seen are surely larger without any of them (the interval of the ratio is above 1). All others
    are in both fits of a ratio: beside a large error that another one explains, what a name gains
    alone is lost. What is unsure is then tried again, unless it pushes out a name that stands.
    points: the base, with one effect more each, and perhaps with all fitted together; at: where the
    search has ended.
    One at a time: a name that goes may have been what hid another.
    """
    if not names:
        return Shown((), (points[0],), {}, {}, {}, {})
    fits = _Fits(with_, at, noise, names, points[0])
    first = fits.back(*fits.sure(fits.graded(names, points[-1])))
    stands = _tested(fits, *first)
    if stands.kept.names != first[0].names:
        stands = _retried(fits, stands)
    kept, of = stands.kept, stands.kept.of
    if not kept.names:
        return Shown((), (points[0],), {}, {}, {}, stands.left_out)
    steps = tuple(_steps(with_, points, at, noise, kept.names, kept.fit))
    gains = with_.gains(kept.names, steps)
    judged = {n: Judged(stands.costs[n], gain) for n, gain in zip(kept.names, gains, strict=True)}
    return Shown(kept.names, steps,
                 {n: Grade(p, sizes(of, n)) for n, p in kept.sure.items()}, judged,
                 {n: constancy(of, n, with_.policy.grade, with_.seed) for n in kept.names},
                 stands.left_out)


class _Graded(NamedTuple):
    """Names, the fit with them, what each did in it, and how sure each is."""

    names: tuple[str, ...]
    fit: Point
    of: Secants
    sure: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class _Fits:
    """Fits of some of the names, from one start, each done once; base: the one without any."""

    with_: Grading
    at: Point
    noise: Noise
    names: Sequence[str]
    base: Point
    _done: dict[tuple[str, ...], Point] = field(default_factory=dict)

    def fit(self, names: Collection[str], near: Point) -> Point:
        """With these names, from a fit with nearly the same."""
        ordered = self._ordered(names)
        if not ordered:
            return self.base
        if ordered not in self._done:
            self._done[ordered] = self.with_.search.fit(self.at, self.noise, ordered, near)
        return self._done[ordered]

    def graded(self, names: Sequence[str], fit: Point) -> _Graded:
        policy, seed = self.with_.policy, self.with_.seed
        of = secants(self.with_.evidence, fit, names, policy)
        return _Graded(tuple(names), fit, of,
                       grades(of, names, policy.grade, seed) if names else {})

    def of(self, names: Collection[str], near: Point) -> _Graded:
        """Of these, in the order in which they gain."""
        return self.graded(self._ordered(names), self.fit(names, near))

    def without(self, those: _Graded, name: str) -> _Graded:
        return self.of(set(those.names) - {name}, those.fit)

    def costs(self, those: _Graded) -> Mapping[str, Cost]:
        """Errors on recordings that no fit has seen without each name, over those with all."""
        return self.with_.costs(those.fit, {n: self.fit(set(those.names) - {n}, those.fit)
                                            for n in those.names})

    def sure(self, those: _Graded) -> tuple[_Graded, dict[str, LeftOut]]:
        """The least sure leaves until all are sure enough; and those that left."""
        left_out: dict[str, LeftOut] = {}
        while those.names and not self._are(those):
            worst = min(those.names, key=lambda n: those.sure[n])
            left_out[worst] = LeftOut(those.sure[worst], NOT_SURE)
            those = self.without(those, worst)
        return those, left_out

    def back(self, those: _Graded, left_out: Mapping[str, LeftOut]
             ) -> tuple[_Graded, dict[str, LeftOut]]:
        """With each possible one that left too early, so that all are sure; and who stays away."""
        away, possible = dict(left_out), self.with_.policy.grade.possible
        for name in self.names:
            gone = left_out.get(name)
            if gone is None or gone.why != NOT_SURE or gone.probability < possible:
                continue
            more = self.of({*those.names, name}, those.fit)
            if self._are(more):
                those = more
                del away[name]
        return those, away

    def _ordered(self, names: Collection[str]) -> tuple[str, ...]:
        return tuple(n for n in self.names if n in names)

    def _are(self, those: _Graded) -> bool:
        return all(p >= self.with_.policy.grade.shown for p in those.sure.values())


class _Stands(NamedTuple):
    """What is left on recordings that no fit has seen, what leaving each out costs there, and all
    that has left by now."""

    kept: _Graded
    costs: Mapping[str, Cost]
    left_out: dict[str, LeftOut]


def _tested(fits: _Fits, kept: _Graded, left_out: Mapping[str, LeftOut]) -> _Stands:
    """Drop one name at a time until all have a possible size and surely lower errors."""
    with_, away = fits.with_, dict(left_out)
    while kept.names:
        impossible = {n: why for n in kept.names if (why := with_.impossible(kept.fit, n))}
        if impossible:
            worst = min(impossible, key=lambda n: kept.sure[n])
            why = impossible[worst]
        else:
            costs = fits.costs(kept)
            worst = min(costs, key=lambda n: sure_ratio(costs[n]))
            if sure_ratio(costs[worst]) > 1.0:
                return _Stands(kept, costs, away)
            why = no_gain(costs[worst])
        away[worst] = LeftOut(kept.sure[worst], why)
        kept, unsure = fits.sure(fits.without(kept, worst))
        away |= unsure
    return _Stands(kept, {}, away)


def impossible_size(fit: Point, name: str) -> str:
    """Why no car has the size that an effect has in a fit; empty where one may have it."""
    active = next(a for a in fit.vehicle.effects if a.name == name)
    whys = (q.impossible(float(value))
            for q, value in zip(active.effect.parameters, active.values, strict=True))
    return "; ".join(why for why in whys if why)


def sure_ratio(cost: Cost) -> float:
    """How many times as large errors surely are without a name; the ratio where no interval is."""
    ratio, low, _ = cost
    return low if np.isfinite(low) else ratio


def no_gain(cost: Cost) -> str:
    """Why a name is dropped that does not surely lower errors, with the figures."""
    ratio, low, high = cost
    between = f" [{low:.3f}, {high:.3f}]" if np.isfinite(low) else ""
    return f"{NO_GAIN}: they are {ratio:.3f}{between} times as large without it"


def _retried(fits: _Fits, stands: _Stands) -> _Stands:
    """With what is unsure no more, and lowers errors, but pushes out nothing that stands."""
    while True:
        kept, left_out = fits.back(stands.kept, stands.left_out)
        new = set(kept.names) - set(stands.kept.names)
        if not new:
            return stands
        tested = _tested(fits, kept, left_out)
        if set(stands.kept.names) <= set(tested.kept.names):
            stands = tested
        else:
            stands = stands._replace(left_out=stands.left_out | {
                n: LeftOut(kept.sure[n], NO_GAIN) for n in new})


def _steps(with_: Grading, points: Sequence[Point], at: Point, noise: Noise, kept: Sequence[str],
           last: Point) -> Sequence[Point]:
    """With one effect more each, as far as that is not what ``points`` are; the end is ``last``."""
    if points[-1] is last:
        return points
    return (*with_.search.steps(points[0], at, noise, kept[:-1]), last)
