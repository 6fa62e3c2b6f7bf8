"""The conclusion from a search: spurious causes withdrawn, stages, gains, verdict."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.types import IntArray
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import unit, value, with_values
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.report.numbers import larger

from .alternatives import include_alternatives, list_exchanges
from .cautions import EDGE, cautions, worse_at
from .error_summaries import Excess, LateCommands, Outliers, find_excesses
from .evidence.noise import Noise
from .evidence.rows import RowLabels
from .evidence.space import MessageTiming
from .final_fit import FinalFit, error_of_size, make_equal_fits, make_final_fits
from .frames import describe_frame
from .gains import Fitted, overall
from .gates import WITHDRAWN
from .grade.accept import Acceptance, Accepted, accept_effects, impossible_size
from .grade.secants import secants
from .judge import Predictor, compute_costs, compute_gains
from .late_commands import find_late_commands
from .mounted import Mounted, mounted, of_the_imu
from .noise_floor import estimate_noise_floor
from .parameters.claims import Asked, claims
from .parameters.sets import Sets
from .parameters.unseen import Unseen
from .policy import MANY_RECORDINGS
from .predictor import find_predictor
from .question import Question
from .report.words import removes
from .result import (
    Cause,
    Claim,
    Considered,
    Cost,
    Diagnosis,
    Gained,
    Moved,
    Number,
    Possible,
    Stage,
    Unexplained,
    added,
)
from .search.fit import FittedModel, Point, covariance
from .search.forward import SearchResult, select_noise
from .search.selection import AcceptedEffect, label_point_rows
from .search.significance import refit_p_value
from .spurious import find_spurious
from .unexplained.outliers import find_outliers
from .unexplained.structure import find_structure
from .unexplained.waits import remove_frame_wait

Remainder = Unexplained | Outliers | Excess | LateCommands
"""What no accepted cause explains."""

def conclude(q: Question, found: SearchResult, files: Mapping[str, Mapping[str, Any]],
             began: float) -> Diagnosis:
    """Everything a report needs."""
    at = _mounted(q, found.point, found.noise)
    left = _left(q, at)
    withdrawn = find_spurious(q, found, left)
    named = tuple(n for n in found.accepted if n.effect not in withdrawn)
    points = found.points
    if withdrawn:
        points = q.search.fit_nested(found.base, found.point, found.noise, [n.effect
                                                                            for n in named])
        at = _mounted(q, points[-1], found.noise)
        left = _left(q, at)
    unseen = Unseen(q.test.evidence, found.point, q.settings.policy)
    predicting = partial(as_predicted, q, (found.point.timing, unseen.timing(found.point)))
    how = Acceptance(q.search, q.train.evidence, q.settings.policy, q.settings.seed,
                     impossible_size, partial(compute_costs, unseen))
    accepted = accept_effects(how, points, found.point, found.noise, [n.effect for n in named])
    noise = select_noise(accepted.names, found.noise, found.base_noise)
    if accepted.names and not np.array_equal(noise.motion, found.noise.motion):
        # the rejected effects had shaped the noise
        points = q.search.fit_nested(found.base, found.point, noise, accepted.names)
        again = accept_effects(how, points, found.point, noise, accepted.names)
        accepted = replace(again, rejected={**accepted.rejected, **again.rejected})
    if accepted.rejected:
        points, named = accepted.points, tuple(n for n in named if n.effect in accepted.names)
        at = _mounted(q, points[-1], noise)
        left = _left(q, at)
    last = points[-1]
    fits = make_equal_fits(q.search, q.train, found.base.noise, partial(as_logged, q),
                           q.settings.jobs,
                           MANY_RECORDINGS if q.refit else sys.maxsize)
    finals = make_final_fits(fits, points, lambda point: covariance(point, _blocks(q, point)))
    final = finals[-1]
    gains = dict(zip(accepted.names, compute_gains(
        q.train, q.test, q.settings, unseen, predicting, accepted.names, finals), strict=True))
    stages = _stages(q, found.given, finals, named, predicting, unseen)
    distinguished, possible = _told_apart(q, found, named), _possible(found, accepted, q)
    exchanges = list_exchanges({one.effect: one.confounders for one in distinguished},
                               [n for n, grade in accepted.grades.items() if grade.probability
                                < q.settings.policy.grade.confident],
                               [one.effect for one in possible])
    fitted_to = q.train.evidence if final.point is last else fits.evidence
    final = include_alternatives(final, exchanges, q.search, fitted_to, q.settings.policy.scan)
    causes = tuple(_cause(q, one, last, final, accepted, gains[one.effect])
                   for one in distinguished)
    moved = _moved(q, final)
    claimed = _claims(q, last, final, unseen) if q.refit else ()
    given, fitted = (
        Fitted(vehicle, predicted, (point.timing, unseen.timing(point)), q.refit)
        for point, vehicle, predicted in (
            (found.given, found.given.vehicle, given_as_predicted(q, found.given, predicting)),
            (final, final.vehicle, predicting(final))))
    gain = overall(given, fitted, q.train, q.test, q.settings.seed,
                   q.settings.policy.conclusion.gain_block_s)
    notes = (*cautions(last, (q.train, q.test), moved, gain, causes, q.settings.policy),
             *describe_frame(final.vehicle, q.frame))
    outliers = find_outliers(q.train.evidence, final.vehicle, final.timing, q.settings.policy.noise)
    floor = estimate_noise_floor(q.test, final.vehicle, unseen.timing(final), predicting(final)[1],
                                 q.settings.policy.unexplained)
    excesses = find_excesses(stages[-1].horizons, floor)
    late = find_late_commands((q.train, q.test), final.vehicle,
                              (final.timing, unseen.timing(final)), q.settings.policy.unexplained)
    remainder: list[Remainder] = [*left, *outliers, *excesses, *([late] if late else [])]
    return Diagnosis(
        verdict=_verdict(q, found, causes, remainder, gain, claimed, possible),
        model=q.model, refitted=moved, causes=causes,
        considered=_considered(found, withdrawn, accepted), possible=possible, claims=claimed,
        unexplained=left, outliers=outliers, stages=stages,
        evidence=q.test.evidence, ctrv=q.test.horizons(None), noise_floor=floor, late_commands=late,
        gain=gain, files=files, seed=q.settings.seed, withdrawn=withdrawn, notes=notes,
        mounting=of_the_imu(at, q.train.evidence, q.settings.policy),
        predictor=find_predictor(fits, q.train, q.test, last) if q.predictor else None,
        runtime_s=time.monotonic() - began, false_alarm=q.settings.false_alarm,
        ranking={t.effect: t.gain for t in found.ranking})


def as_logged(q: Question, point: FittedModel) -> Vehicle:
    """The vehicle of a point; where its delays were fitted, counted from the log.

    Whoever predicts from a log has its commands only when they stand there.
    """
    p, age = point.vehicle, point.timing.command_age
    return p if not q.refit else with_values(p, {
        name: max(0.0, value(p, name) - age) for name in ("delay.steering_s", "delay.throttle_s")})


def as_predicted(q: Question, timings: tuple[MessageTiming, MessageTiming], point: FittedModel
                 ) -> tuple[Vehicle, Vehicle]:
    """The vehicle of a point as it predicts from the logs of the train and the test recordings.

    timings: of these recordings. A refit counts delays from the log. Without one the delays are
    those of the car, and the commands are as old in each log as suits its recordings best.
    """
    if q.refit:
        logged = as_logged(q, point)
        return logged, logged
    return timings[0].shift_delays(point.vehicle), timings[1].shift_delays(point.vehicle)


def given_as_predicted(q: Question, given: Point, predicting: Predictor
                       ) -> tuple[Vehicle, Vehicle]:
    """The model as it was given, in the same way; with a refit just as its file has it."""
    return (q.base, q.base) if q.refit else predicting(given)


def _mounted(q: Question, point: Point, noise: Noise) -> Mounted:
    return mounted(q.search, q.train.evidence, point, noise)


def _left(q: Question, at: Mounted) -> tuple[Unexplained, ...]:
    """Structure that neither causes explain nor how the sensors are mounted."""
    evidence, point = q.train.evidence, at.point
    r = remove_frame_wait(evidence, point.vehicle, point.timing, at.noise)
    return find_structure(evidence, point.vehicle, r, at.noise, q.settings.seed,
                       q.settings.false_alarm, q.settings.policy.unexplained)


def _stages(q: Question, given: Point, points: Sequence[FittedModel],
            named: Sequence[AcceptedEffect], predicting: Predictor, unseen: Unseen) -> tuple[Stage,
                                                                                             ...]:
    """Errors of the given model, the refitted one, and with one name more each."""
    labels = ["refitted" if q.refit else q.model, *(added(n.effect) for n in named)]
    stages = [_stage(q, label, p, (as_logged(q, p), predicting(p)[1]), unseen)
              for label, p in zip(labels, points, strict=True)]
    base = [_stage(q, q.model, given, (q.base, q.base), unseen)] if q.refit else []
    return tuple(base + stages)


def _stage(q: Question, label: str, point: FittedModel, vehicles: tuple[Vehicle, Vehicle],
           unseen: Unseen) -> Stage:
    """vehicles: as it is written, and as it predicts from the log of the test recordings."""
    r = q.test.evidence.residuals(point.vehicle, unseen.timing(point))
    return Stage(label, vehicles[0], q.test.horizons(vehicles[1], r), r)


def _told_apart(q: Question, found: SearchResult,
                named: Sequence[AcceptedEffect]) -> list[AcceptedEffect]:
    """Names with what each cannot be told from, asked only of those that are shown: it is slow."""
    alike = {one.effect: one for one in each(found.add_confounders, named, q.settings.jobs)}
    return [alike[one.effect] for one in named]


def _cause(q: Question, named: AcceptedEffect, last: Point, final: FinalFit, accepted: Accepted,
           gain: Gained) -> Cause:
    """One cause, its numbers at the end. last: the fit by which its sizes in each recording are."""
    effect = catalogue()[named.effect]
    numbers = {}
    for parameter in effect.parameters:
        key = f"{effect.name}.{parameter.name}"
        size = float(value(final.vehicle, key))
        numbers[parameter.name] = Number(size, error_of_size(size - parameter.null,
                                                             final.stds[key]),
                                         parameter.unit, parameter.null)
    grade, cost = accepted.grades[effect.name], accepted.costs[effect.name]
    first = effect.parameters[0]
    share = ((float(value(last.vehicle, f"{effect.name}.{first.name}")) - first.null)
             / (numbers[first.name].value - first.null or math.nan))
    sizes = [(share * size, abs(share) * error) for size, error in grade.sizes]
    return Cause(effect.name, effect.title, effect.stage, numbers, named.p_value, named.gain,
                 _evidence(q, named, numbers, gain, cost), gain, named.confounders,
                 effect.experiment, grade.probability,
                 dict(zip(q.train.names, sizes, strict=True)),
                 accepted.constancy[effect.name], cost)


def _evidence(q: Question, named: AcceptedEffect, numbers: Mapping[str, Number], gain: Gained,
              cost: Cost) -> tuple[str, ...]:
    key, number = max(numbers.items(), key=lambda kn: abs(kn[1].value - kn[1].null)
                      / max(kn[1].std, 1e-12))
    away = abs(number.value - number.null) / max(number.std, 1e-12)
    return (
        f"robust loss {named.gain:.0f} lower on the training recordings; with nothing missing, "
        f"some effect gains what counts like {named.threshold:.0f} of this one in "
        f"{100.0 * q.settings.false_alarm:g} cases of 100",
        f"{key} is {away:.0f} standard errors from its null",
        f"errors on the test recordings are {larger(*cost)} without it",
        f"{gain.measure}: {removes(gain)}")


def _claims(q: Question, last: Point, final: FinalFit, unseen: Unseen) -> tuple[Claim, ...]:
    """Parameters of the base that were wrong, at the final model."""
    settings = q.settings
    if unseen.last is not last:
        unseen = Unseen(q.test.evidence, last, settings.policy)
    of = secants(q.train.evidence, last, (), settings.policy)
    sets = Sets(q.train.evidence, q.base, last, of.unit, settings.known, settings.policy)
    return claims(Asked(sets, unseen, of, final, as_logged(q, final), settings.seed))


def _blocks(q: Question, point: Point) -> IntArray:
    rows = _rows(q, point)
    many = rows.recording.max() + 1 >= MANY_RECORDINGS
    return rows.recording if many else rows.block


def _rows(q: Question, point: Point) -> RowLabels:
    return label_point_rows(q.train.evidence, point, q.settings.policy)


def _moved(q: Question, final: FinalFit) -> dict[str, Moved]:
    """Base parameters after the refit, those of effects that the base has among them."""
    own = {f"{a.name}.{k.name}" for a in q.base.effects for k in a.effect.parameters}
    point = final.point
    space = point.space
    if not q.refit:
        return {}
    out, logged = {}, as_logged(q, final)
    for i, name in enumerate(space.names):
        if name not in q.settings.free and name not in own:
            continue
        doubt = ""
        # no time is below 0, and in many a car it is 0
        if ((point.x[i] - space.low[i] < 1e-6 and value(logged, name) > 0.0)
                or space.high[i] - point.x[i] < 1e-6):
            doubt = EDGE
        elif abs(point.x[i]) > q.settings.policy.prior.believed:
            doubt = f"{abs(point.x[i]):.1f} prior standard deviations from where it was"
        out[name] = Moved(float(value(q.base, name)), float(value(logged, name)),
                          final.stds[name], unit(q.base, name), doubt)
    return out


def _possible(found: SearchResult, accepted: Accepted, q: Question) -> tuple[Possible, ...]:
    """Names whose grade is too low to be shown, the surest first."""
    policy = q.settings.policy.grade
    loss = {n.effect: n.gain for n in found.accepted}
    ordered = sorted(accepted.rejected.items(), key=lambda item: -item[1].probability)
    return tuple(Possible(name, catalogue()[name].title, one.probability, loss[name], one.why,
                          "likely" if one.probability >= policy.likely else "possible")
                 for name, one in ordered if one.probability >= policy.possible)


def _considered(found: SearchResult, withdrawn: Sequence[str], accepted: Accepted
                ) -> tuple[Considered, ...]:
    out = [Considered(n.effect, n.p_value, n.gain, WITHDRAWN)
           for n in found.accepted if n.effect in withdrawn]
    out += [Considered(n.effect, n.p_value, n.gain,
                       f"not accepted, with probability "
                       f"{accepted.rejected[n.effect].probability:.2f}: "
                       f"{accepted.rejected[n.effect].why}")
            for n in found.accepted if n.effect in accepted.rejected]
    return (*out, *(Considered(r.effect, r.p_value, r.gain, r.reason)
                    for r in found.rejected if r.effect not in withdrawn))


def _verdict(q: Question, found: SearchResult, causes: Sequence[Cause],
             left: Sequence[Remainder],
             gain: Mapping[str, Gained], claimed: Sequence[Claim],
             possible: Sequence[Possible]) -> str:
    changes = not (all(c.constancy.constant for c in causes) and all(c.constant for c in claimed))
    if causes:  # one that surely makes predictions worse does not explain
        worse = any(c.gain.high < 0.0 for c in causes)
        return "partly_explained" if left or worse or changes else "explained"
    if left or changes:
        return "unexplained"
    if claimed:
        return "parameters_only"
    if q.refit:
        p = refit_p_value(found.base, found.refit_loss, _rows(q, found.base).block,
                          q.settings.seed, q.settings.policy.naming.draws)
        better = not gain or any(g.low > 0.0 for g in gain.values())
        if (p < q.settings.false_alarm and better
                and not worse_at(gain, q.settings.policy.conclusion)):
            return "parameters_only"
    # the search named it, which it does in 1 of 100 sound cars: something is wrong
    return "unexplained" if possible else "nothing_wrong"
