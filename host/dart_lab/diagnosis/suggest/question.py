"""One cause and all that it cannot be told from, at the sizes that suit the data at hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.vehicle.effects import catalogue, remove_effects
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.noise import Noise, estimate_noise
from ..evidence.residuals import Evidence
from ..evidence.space import MessageTiming, Space
from ..policy import USUAL, Policy
from ..result import Cause, Diagnosis
from ..search.fit import evaluate_point
from .contest import Contest
from .evidence import Setting, setting, without_mocap
from .side import Side
from .sizes import Sizes

SETTLE = 3  # steps of the timing of the data at hand


@dataclass(frozen=True, slots=True)
class Question:
    """Hypotheses, the cause first.

    base: the model without any of them; cars, values: what each makes of the
    data at hand, and its size; before: separation by (truth, confounder); free,
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
    policy: Policy

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.cars)


def ask(diagnosis: Diagnosis, cause: Cause, policy: Policy = USUAL) -> Question:
    """The question that a diagnosis leaves open about one of its causes."""
    others = [name for name in cause.cannot_be_told_from if name in catalogue()]
    others = others[:policy.suggest.confounders]
    full, evidence = diagnosis.extended, diagnosis.evidence
    base = remove_effects(full, [cause.effect])
    free = tuple(diagnosis.refitted)
    known = {name: moved.std for name, moved in diagnosis.refitted.items()
             if math.isfinite(moved.std)}
    timing = _timing(diagnosis, full, policy)

    def contest(e: Evidence, truth: Vehicle) -> Contest:
        side = Side(e, _noise(e, base, timing, policy), base, truth, free, known, timing,
                    policy.prior)
        return Contest([side], base)

    values = {cause.effect: {k: n.value for k, n in cause.parameters.items()}}
    cars, before = {cause.effect: full}, {}
    first = contest(evidence, full)
    nothing = first.sides[0].loss(base)
    for name in others:
        mimic = first.mimic(name)
        if mimic is None or mimic.loss > (1.0 - policy.suggest.explains) * nothing:
            continue  # the data at hand have told these apart
        cars[name], values[name] = mimic.car, dict(mimic.values)
        before[cause.effect, name] = before[name, cause.effect] = mimic.separation
    others = [name for name in others if name in cars]
    for name in others if len(others) > 1 else ():
        work = contest(evidence, cars[name])
        for confounder in others:
            mimic = work.mimic(confounder) if confounder != name else None
            if mimic is not None:
                before[name, confounder] = mimic.separation
    reference = evidence.drives[0].grid.reference
    alone = without_mocap(evidence, policy)
    seen = [(alone, contest(alone, full))] if alone is not None else []
    judged = [(setting(e, base, full, timing, reference, policy), work)
              for e, work in (*seen, (evidence, first))]
    return Question(base, cars, values, before, free, known, tuple(s for s, _ in judged),
                    {s.needs: Sizes(work, values) for s, work in judged}, policy)


def _timing(diagnosis: Diagnosis, p: Vehicle, policy: Policy) -> MessageTiming:
    """That of the data at hand, which a diagnosis does not tell."""
    evidence, timing = diagnosis.evidence, MessageTiming()
    bare = Space(replace(p, effects=()), (), policy=policy.prior)
    for _ in range(SETTLE):
        noise = _noise(evidence, p, timing, policy)
        point = evaluate_point(evidence, noise, bare, bare.point(timing))
        own = noise.stack(evidence.residuals(p, timing))[0]
        timing = bare.split(np.clip(point.x + point.best_step(own), bare.low, bare.high))[1]
    return timing


def _noise(evidence: Evidence, p: Vehicle, timing: MessageTiming, policy: Policy) -> Noise:
    return estimate_noise(evidence.residuals(p, timing), evidence.blocks(policy.blocks.seconds),
                   policy=policy.noise)
