"""One cause and all that it cannot be told from, at the sizes that suit the data at hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.parameters import Vehicle

from ..fit import at
from ..noise import Noise, measure
from ..residuals import Evidence
from ..result import Cause, Diagnosis
from ..space import Space, Timing
from .contest import Contest
from .evidence import BLOCK, Setting, setting, without_mocap
from .side import Side
from .sizes import Sizes

MOST = 4  # rivals of one cause that are looked at, the nearest ones
LEAST = 0.25  # of what the cause explains: a rival that explains less is none
SETTLE = 3  # steps of the timing of the data at hand


@dataclass(frozen=True, slots=True)
class Question:
    """Hypotheses, the cause first.

    base: the model without any of them; cars, values: what each makes of the
    data at hand, and its size; before: separation by (truth, rival); free,
    known: base parameters that follow, with their standard errors; settings:
    how a drive could be judged, the one that needs least first; sizes: what else
    the hypotheses could be, by ``Setting.needs``.
    """

    base: Vehicle
    cars: Mapping[str, Vehicle]
    values: Mapping[str, Mapping[str, float]]
    before: Mapping[tuple[str, str], float]
    free: tuple[str, ...]
    known: Mapping[str, float]
    settings: tuple[Setting, ...]
    sizes: Mapping[str, Sizes]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.cars)


def ask(diagnosis: Diagnosis, cause: Cause) -> Question:
    """The question that a diagnosis leaves open about one of its causes."""
    like = [name for name in cause.cannot_be_told_from if name in catalogue()][:MOST]
    full, evidence = diagnosis.extended, diagnosis.evidence
    base = replace(full, effects=tuple(a for a in full.effects if a.name != cause.effect))
    free = tuple(diagnosis.refitted)
    known = {name: moved.std for name, moved in diagnosis.refitted.items()
             if math.isfinite(moved.std)}
    timing = _timing(diagnosis, full)

    def contest(e: Evidence, truth: Vehicle) -> Contest:
        side = Side(e, _noise(e, base, timing), base, truth, free, known, timing)
        return Contest([side], base)

    values = {cause.effect: {k: n.value for k, n in cause.parameters.items()}}
    cars, before = {cause.effect: full}, {}
    first = contest(evidence, full)
    nothing = first.sides[0].loss(base)
    for name in like:
        mimic = first.mimic(name)
        if mimic is None or mimic.loss > (1.0 - LEAST) * nothing:
            continue  # the data at hand have told these apart
        cars[name], values[name] = mimic.car, dict(mimic.values)
        before[cause.effect, name] = before[name, cause.effect] = mimic.separation
    like = [name for name in like if name in cars]
    for name in like if len(like) > 1 else ():
        work = contest(evidence, cars[name])
        for rival in like:
            mimic = work.mimic(rival) if rival != name else None
            if mimic is not None:
                before[name, rival] = mimic.separation
    reference = evidence.drives[0].grid.reference
    alone = without_mocap(evidence)
    seen = [(alone, contest(alone, full))] if alone is not None else []
    judged = [(setting(e, base, full, timing, reference), work)
              for e, work in (*seen, (evidence, first))]
    return Question(base, cars, values, before, free, known, tuple(s for s, _ in judged),
                    {s.needs: Sizes(work, values) for s, work in judged})


def _timing(diagnosis: Diagnosis, p: Vehicle) -> Timing:
    """That of the data at hand, which a diagnosis does not tell."""
    evidence, timing = diagnosis.evidence, Timing()
    bare = Space(replace(p, effects=()), ())
    for _ in range(SETTLE):
        noise = _noise(evidence, p, timing)
        point = at(evidence, noise, bare, bare.point(timing))
        own = noise.stacked(evidence.residuals(p, timing))[0]
        timing = bare.split(np.clip(point.x + point.follow(own), bare.low, bare.high))[1]
    return timing


def _noise(evidence: Evidence, p: Vehicle, timing: Timing) -> Noise:
    return measure(evidence.residuals(p, timing), evidence.blocks(BLOCK))
