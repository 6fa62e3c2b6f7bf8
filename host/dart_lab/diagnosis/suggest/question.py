"""One cause and all its confounders, at the sizes that fit the data at hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.vehicle.effects import catalogue, remove_effects
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.noise import Noise, estimate_noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import evaluate_point

from ..policy import USUAL, Policy
from ..result import Cause, Diagnosis
from .contest import DriveComparison
from .evidence import Setting, make_setting, select_onboard
from .side import RecordingComparison
from .sizes import SizeLossCurves

MAX_CONFOUNDERS = 4  # of one cause that are looked at, the nearest ones
TIMING_ITERATIONS = 3  # linear steps of the timing


@dataclass(frozen=True, slots=True)
class ConfounderQuestion:
    """Hypotheses, the cause first.

    base: the model without any of them. cars, values: by hypothesis, its car fitted to the data at
    hand, and its size. before: separation by (truth, confounder). free, known: fitted base
    parameters with their standard errors. settings: how a drive could be judged, fewest sensors
    first. sizes: loss of other sizes, by ``Setting.needs``.
    """

    base: Vehicle
    cars: Mapping[str, Vehicle]
    values: Mapping[str, Mapping[str, float]]
    before: Mapping[tuple[str, str], float]
    free: tuple[str, ...]
    known: Mapping[str, float]
    settings: tuple[Setting, ...]
    sizes: Mapping[str, SizeLossCurves]
    policy: Policy

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.cars)


def make_question(diagnosis: Diagnosis, cause: Cause, policy: Policy = USUAL) -> ConfounderQuestion:
    """Make the question that a diagnosis leaves open about one of its causes."""
    others = [name for name in cause.cannot_be_told_from if name in catalogue()]
    others = others[:MAX_CONFOUNDERS]
    full = diagnosis.extended
    evidence = diagnosis.evidence
    base = remove_effects(full, [cause.effect])
    free = tuple(diagnosis.refitted)
    known = {name: moved.std for name, moved in diagnosis.refitted.items()
             if math.isfinite(moved.std)}
    timing = _timing(diagnosis, full, policy)

    def compare(e: Evidence, truth: Vehicle) -> DriveComparison:
        recording = RecordingComparison(e, _noise(e, base, timing, policy), base, truth, free,
                                        known, timing, policy.prior)
        return DriveComparison([recording], base)

    values = {cause.effect: {k: n.value for k, n in cause.parameters.items()}}
    cars = {cause.effect: full}
    before = {}
    # The cause is the truth: fit each confounder to it.
    first = compare(evidence, full)
    base_loss = first.recordings[0].loss(base)
    for name in others:
        fitted = first.fit_confounder(name)
        if fitted is None or fitted.loss > (1.0 - policy.suggest.min_explained_share) * base_loss:
            continue  # the data at hand distinguish these
        cars[name] = fitted.car
        values[name] = dict(fitted.values)
        before[cause.effect, name] = before[name, cause.effect] = fitted.separation
    # Each confounder in turn is the truth.
    others = [name for name in others if name in cars]
    for name in others if len(others) > 1 else ():
        comparison = compare(evidence, cars[name])
        for confounder in others:
            fitted = comparison.fit_confounder(confounder) if confounder != name else None
            if fitted is not None:
                before[name, confounder] = fitted.separation
    reference = evidence.drives[0].grid.reference
    alone = select_onboard(evidence, policy)
    onboard = [(alone, compare(alone, full))] if alone is not None else []
    judged = [(make_setting(e, base, full, timing, reference, policy), comparison)
              for e, comparison in (*onboard, (evidence, first))]
    return ConfounderQuestion(base, cars, values, before, free, known, tuple(s for s, _ in judged),
                              {s.needs: SizeLossCurves(comparison, values) for s,
                               comparison in judged}, policy)


def _timing(diagnosis: Diagnosis, p: Vehicle, policy: Policy) -> MessageTiming:
    """Estimate the timing of the data at hand, which a diagnosis does not report."""
    evidence = diagnosis.evidence
    timing = MessageTiming()
    bare = Space(replace(p, effects=()), (), policy=policy.prior)
    for _ in range(TIMING_ITERATIONS):
        noise = _noise(evidence, p, timing, policy)
        point = evaluate_point(evidence, noise, bare, bare.point(timing))
        own = noise.stack(evidence.residuals(p, timing))[0]
        timing = bare.split(np.clip(point.x + point.best_step(own), bare.low, bare.high))[1]
    return timing


def _noise(evidence: Evidence, p: Vehicle, timing: MessageTiming, policy: Policy) -> Noise:
    """Measure the noise of an evidence."""
    return estimate_noise(evidence.residuals(p, timing), evidence.blocks(),
                   policy=policy.noise)
