"""Which names are shown: each with its grade, and what is only possible left out of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..evidence.noise import Noise
from ..evidence.residuals import Evidence
from ..policy import Policy
from ..result import Constancy
from ..search.fit import Point
from ..search.forward import Search
from .bag import Grade, grade
from .constancy import constancy
from .secants import secants


@dataclass(frozen=True, slots=True)
class Shown:
    """Names in the order of their gain, the fits with one more each, and what was left out."""

    names: tuple[str, ...]
    points: tuple[Point, ...]
    grades: Mapping[str, Grade]
    constancy: Mapping[str, Constancy]
    left_out: Mapping[str, Grade]


@dataclass(frozen=True, slots=True)
class Grading:
    """What it takes to grade: the search that made the fits, and the training evidence."""

    search: Search
    evidence: Evidence
    policy: Policy
    seed: int


def shown(with_: Grading, points: Sequence[Point], at: Point, noise: Noise,
          names: Sequence[str]) -> Shown:
    """Leave out the name of the lowest grade until all that are left are sure enough.

    points: the base, and with one effect more each; at: where the search has ended.
    One at a time: a name that goes may have been what hid another.
    """
    left_out: dict[str, Grade] = {}
    kept = list(names)
    while kept:
        of = secants(with_.evidence, points[-1], kept, with_.policy)
        grades = {name: grade(of, name, kept[:i], with_.policy.grade, with_.seed)
                  for i, name in enumerate(kept)}
        worst = min(kept, key=lambda n: grades[n].probability)
        if grades[worst].probability >= with_.policy.grade.shown:
            return Shown(tuple(kept), tuple(points), grades,
                         {n: constancy(of, n, with_.policy.grade, with_.seed) for n in kept},
                         left_out)
        left_out[worst] = grades[worst]
        kept.remove(worst)
        points = with_.search.steps(points[0], at, noise, kept)
    return Shown((), tuple(points), {}, {}, left_out)
