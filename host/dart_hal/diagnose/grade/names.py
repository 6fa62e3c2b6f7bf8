"""Which names are shown: each with its grade, and what is only possible left out of the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..evidence.noise import Noise
from ..evidence.residuals import Evidence
from ..policy import Policy
from ..result import Constancy, Gained
from ..search.fit import Point
from ..search.forward import Search
from .bag import Grade, grade
from .constancy import constancy
from .secants import secants

NOT_SURE = "too few of the data left out from its size want it beside the others"
NO_GAIN = "it does not surely lower the errors on recordings that no fit has seen"


@dataclass(frozen=True, slots=True)
class Shown:
    """Names in the order of their gain, the fits with one more each, and what was left out."""

    names: tuple[str, ...]
    points: tuple[Point, ...]
    grades: Mapping[str, Grade]
    gains: Mapping[str, Gained]
    constancy: Mapping[str, Constancy]
    left_out: Mapping[str, LeftOut]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A name that is not shown: its probability, and why."""

    probability: float
    why: str


@dataclass(frozen=True, slots=True)
class Grading:
    """What it takes to grade: the search that made the fits, and the training evidence.

    gain(effect, before, after): on recordings that no fit has seen; several: there are enough of
    them for an interval.
    """

    search: Search
    evidence: Evidence
    policy: Policy
    seed: int
    gain: Callable[[str, Point, Point], Gained]
    several: bool


def shown(with_: Grading, points: Sequence[Point], at: Point, noise: Noise,
          names: Sequence[str]) -> Shown:
    """Leave out the name of the lowest grade until all that are left are sure enough.

    Then the one that gains least, until all lower the errors on recordings that no fit has seen.
    points: the base, and with one effect more each; at: where the search has ended.
    One at a time: a name that goes may have been what hid another.
    """
    left_out: dict[str, LeftOut] = {}
    kept, last = list(names), points[-1]
    while kept:
        of = secants(with_.evidence, last, kept, with_.policy)
        grades = {name: grade(of, name, kept[:i], with_.policy.grade, with_.seed)
                  for i, name in enumerate(kept)}
        worst = min(kept, key=lambda n: grades[n].probability)
        why = NOT_SURE if grades[worst].probability < with_.policy.grade.shown else ""
        if not why:
            points = _steps(with_, points, at, noise, kept, last)
            gains = {name: with_.gain(name, points[i], points[i + 1])
                     for i, name in enumerate(kept)}
            worst = min(kept, key=lambda n: _least(gains[n], with_.several))
            why = NO_GAIN if _least(gains[worst], with_.several) <= 0.0 else ""
        if not why:
            return Shown(tuple(kept), tuple(points), grades, gains,
                         {n: constancy(of, n, with_.policy.grade, with_.seed) for n in kept},
                         left_out)
        left_out[worst] = LeftOut(grades[worst].probability, why)
        kept.remove(worst)
        last = with_.search.fit(at, noise, kept, last)
    return Shown((), (points[0],), {}, {}, {}, left_out)


def _steps(with_: Grading, points: Sequence[Point], at: Point, noise: Noise, kept: Sequence[str],
           last: Point) -> Sequence[Point]:
    """With one effect more each, as far as that is not what ``points`` are; the end is ``last``."""
    if points[-1] is last:
        return points
    return (*with_.search.steps(points[0], at, noise, kept[:-1]), last)


def _least(gain: Gained, several: bool) -> float:
    """What is surely gained; where there are too few recordings for an interval, what is."""
    least = gain.low if several and np.isfinite(gain.low) else gain.test
    return least if np.isfinite(least) else np.inf
