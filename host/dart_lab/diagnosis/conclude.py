"""Conclude from a search: withdraw spurious causes, accept effects, measure gains, and judge."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import unit, value, with_values
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import is_straight
from dart_lab.identification.evidence.policy import MANY_RECORDINGS
from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.identification.objective import FittedModel, Point, covariance
from dart_lab.report.numbers import describe_change

from .alternatives import include_alternatives, include_sizes, include_tyre_shape, list_exchanges
from .cautions import AT_BOUND, list_cautions, list_worse_channels
from .error_summaries import Excess, LateCommands, Outliers, find_excesses
from .final_fit import FinalFit, error_of_size, make_equal_fits, make_final_fits
from .frames import describe_frame
from .gains import Fitted, measure_gain, measure_overall_gain
from .gates import IMPROBABLE, WITHDRAWN
from .grade.accept import Acceptance, AcceptedEffects, accept_effects, impossible_size
from .grade.secants import secants
from .late_commands import find_late_commands
from .mounted import MountingFit, describe_imu_mounting, fit_mounting
from .noise_floor import estimate_noise_floor
from .parameters.claims import ClaimInputs, find_claims
from .parameters.sets import GroupFits
from .parameters.unseen import RecordingLosses
from .predictor import find_predictor
from .question import DiagnosisSetup
from .report.words import describe_parts, removes
from .result import (
    Cause,
    Claim,
    Considered,
    Cost,
    Diagnosis,
    ErrorReduction,
    ParameterChange,
    ParameterEstimate,
    Possible,
    Stage,
    Unexplained,
    effect_label,
)
from .search.forward import SearchResult, select_noise
from .search.selection import AcceptedEffect, label_point_rows
from .search.significance import refit_p_value
from .servo import TYRE_CAUTION, describe_servo, fit_servo
from .spurious import find_spurious
from .unexplained.outliers import find_outliers
from .unexplained.structure import find_structure
from .unexplained.waits import remove_frame_wait

# Returns the vehicles that predict from the logs of the training and of the test recordings.
Predictor = Callable[[FittedModel], tuple[Vehicle, Vehicle]]
# Errors that no accepted cause explains.
Finding = Unexplained | Outliers | Excess | LateCommands
FIT_ON_BOUND = 1e-6  # prior standard deviations; a parameter that is nearer to a bound is on it

KEPT_PARAMETERS = ("the parameters of the model keep their values, and what their standard errors "
                   "explain is no cause: if one may have changed, leave out --no-refit")


def conclude(q: DiagnosisSetup, found: SearchResult, files: Mapping[str, Mapping[str, Any]],
             began: float) -> Diagnosis:
    """Conclude from the result of a search.

    1. Withdraw candidates that leave as much structure as there is without them.
    2. Accept the candidates that held-out data and the test recordings support. If those that
       remain change only sensor readings, but a rejected one did not, take the noise of the motion
       from the base model, and accept again.
    3. Fit the numbers that are reported.
    4. Measure the gain of each cause, find its confounders, add the spread over models that fit
       equally well to the standard errors, and find the parameters that were wrong.
    5. List what remains: structure (of step 1 or 2), outliers, errors above the noise floor, late
       commands.

    files: entries of the document by recording. began: time at the start, as ``time.monotonic``.
    """
    policy = q.settings.policy
    # 1.
    mounting = fit_mounting(q.search, q.train.evidence, found.point, found.noise)
    structure = _find_structure(q, mounting)
    withdrawn = find_spurious(q, found, structure)
    named = tuple(n for n in found.accepted if n.effect not in withdrawn)
    points = found.points
    if withdrawn:
        points = q.search.fit_nested(found.base, found.point, found.noise,
                                     [n.effect for n in named])
        mounting = fit_mounting(q.search, q.train.evidence, points[-1], found.noise)
        structure = _find_structure(q, mounting)
    # 2.
    losses = RecordingLosses(q.test.evidence, found.point, policy)
    predictor = partial(vehicles_for_logs, q, (found.point.timing, losses.timing(found.point)))
    context = Acceptance(q.search, q.train.evidence, policy, q.settings.seed,
                         impossible_size, losses.compute_costs)
    accepted = accept_effects(context, points, found.point, found.noise,
                              [n.effect for n in named])
    noise = select_noise(accepted.names, found.noise, found.base_noise)
    if accepted.names and not np.array_equal(noise.motion, found.noise.motion):
        points = q.search.fit_nested(found.base, found.point, noise, accepted.names)
        again = accept_effects(context, points, found.point, noise, accepted.names)
        accepted = replace(again, rejected={**accepted.rejected, **again.rejected})
    if accepted.rejected:
        points = accepted.points
        named = tuple(n for n in named if n.effect in accepted.names)
        mounting = fit_mounting(q.search, q.train.evidence, points[-1], noise)
        structure = _find_structure(q, mounting)
    last = points[-1]
    # 3.
    fits = make_equal_fits(q.search, q.train, found.base.noise, partial(vehicle_for_log, q),
                           q.settings.jobs,
                           MANY_RECORDINGS if q.refit else sys.maxsize)
    complete = points
    if q.refit:
        complete = tuple(fit_servo(q.search, q.train.evidence, p, q.settings.jobs) for p in points)
    finals = make_final_fits(fits, complete, lambda point: covariance(
        point, label_point_rows(q.train.evidence, point).unit))
    final = finals[-1]
    # 4.
    fits_by_effect = [_predict_with(q, losses, point, predictor(point))
                      for point in finals[:len(accepted.names) + 1]]
    gains = {name: measure_gain(catalogue()[name], reference, changed, q.train, q.test,
                                q.settings.seed)
             for name, (reference, changed) in zip(accepted.names, pairwise(fits_by_effect),
                                                   strict=True)}
    stages = _stages(q, found.given, finals, named, predictor, losses)
    distinguished = _find_confounders(q, found, named)
    possible = _list_possible(found, accepted, q)
    exchanges = list_exchanges({one.effect: one.confounders for one in distinguished},
                               [n for n, grade in accepted.grades.items()
                                if grade.probability < policy.grade.confident_probability],
                               [one.effect for one in possible])
    # Other models are fitted to the data of the final fit. Unless that is a fit of the search, they
    # are those of the fits with equal weights, which have no sensors.
    fitted_to = q.train.evidence if final.point is complete[-1] else fits.evidence
    if q.refit:
        final = include_sizes(final, fitted_to, q.settings.known)
        final = include_tyre_shape(final, q.search, fitted_to)
    final = include_alternatives(final, exchanges, q.search, fitted_to, policy.scan)
    causes = tuple(_make_cause(q, one, last, final, accepted, gains[one.effect])
                   for one in distinguished)
    changes = _list_parameter_changes(q, final)
    claims = _find_claims(q, last, final, losses) if q.refit else ()
    changes = _take_errors_of_claims(changes, claims)
    given = _predict_with(q, losses, found.given,
                          given_vehicles_for_logs(q, found.given, predictor))
    fitted = _predict_with(q, losses, final, predictor(final))
    gain = measure_overall_gain(given, fitted, q.train, q.test, q.settings.seed)
    servo_caution = (TYRE_CAUTION,) if complete[-1] is not last else ()
    kept = (KEPT_PARAMETERS,) if q.settings.stated and any(
        one.why == IMPROBABLE for one in accepted.rejected.values()) else ()
    parts = {effect: numbers
             for effect, numbers in {**describe_imu_mounting(mounting, q.train.evidence),
                                     **describe_servo(final, last)}.items()
             if any(number.value != number.null for number in numbers.values())}
    cautions = list_cautions(last, (q.train, q.test), changes, gain, causes, policy)
    notes = (*servo_caution, *kept, *cautions, *describe_parts(parts),
             *describe_frame(final.vehicle, q.frame))
    # 5.
    outliers = find_outliers(q.train.evidence, final.vehicle, final.timing, policy.noise)
    floor = estimate_noise_floor(q.test, final.vehicle, losses.timing(final), predictor(final)[1])
    excesses = find_excesses(stages[-1].horizons, floor)
    late = find_late_commands((q.train, q.test), final.vehicle,
                              (final.timing, losses.timing(final)))
    findings: list[Finding] = [*structure, *outliers, *excesses, *([late] if late else [])]
    return Diagnosis(
        verdict=_verdict(q, found, causes, findings, gain, claims, possible),
        model=q.model, refitted=changes, causes=causes,
        considered=_list_considered(found, withdrawn, accepted), possible=possible, claims=claims,
        unexplained=structure, outliers=outliers, stages=stages,
        evidence=q.test.evidence, ctrv=q.test.horizons(None), noise_floor=floor, late_commands=late,
        gain=gain, files=files, seed=q.settings.seed, withdrawn=withdrawn, notes=notes,
        mounting=parts,
        predictor=(find_predictor(fits, q.train, q.test, complete[0], last) if q.predictor
                   else None),
        correlation=_find_correlation(final, changes),
        runtime_s=time.monotonic() - began, false_alarm=q.settings.false_alarm,
        ranking={t.effect: t.gain for t in found.ranking})


def vehicle_for_log(q: DiagnosisSetup, point: FittedModel) -> Vehicle:
    """Return the vehicle of a point with fitted delays counted from the log.

    A prediction from a log has each command only from its entry in the log on.
    """
    p = point.vehicle
    age = point.timing.command_age
    return p if not q.refit else with_values(p, {
        name: max(0.0, value(p, name) - age) for name in ("delay.steering_s", "delay.throttle_s")})


def vehicles_for_logs(q: DiagnosisSetup, timings: tuple[MessageTiming, MessageTiming],
                      point: FittedModel) -> tuple[Vehicle, Vehicle]:
    """Return the vehicles that predict from the logs of the training and the test recordings.

    timings: of these recordings. A refit counts delays from the log. Without one the delays are
    those of the car, and the commands have the age that suits the recordings best.
    """
    if q.refit:
        logged = vehicle_for_log(q, point)
        return logged, logged
    return timings[0].shift_delays(point.vehicle), timings[1].shift_delays(point.vehicle)


def given_vehicles_for_logs(q: DiagnosisSetup, given: Point, predictor: Predictor
                            ) -> tuple[Vehicle, Vehicle]:
    """Return the vehicles by which the model as given predicts, as ``vehicles_for_logs``.

    Before a refit that is the model exactly as in its file, for training and test recordings.
    """
    return (q.base, q.base) if q.refit else predictor(given)


def _predict_with(q: DiagnosisSetup, losses: RecordingLosses, point: FittedModel,
                  logged: tuple[Vehicle, Vehicle]) -> Fitted:
    """Return a fit with the vehicles by which it predicts from the logs, and its timings."""
    return Fitted(point.vehicle, logged, (point.timing, losses.timing(point)), q.refit)


def _find_structure(q: DiagnosisSetup, mounting: MountingFit) -> tuple[Unexplained, ...]:
    """Find structure that neither causes nor the mounting of the sensors explain."""
    evidence = q.train.evidence
    point = mounting.point
    r = remove_frame_wait(evidence, point.vehicle, point.timing, mounting.noise)
    return find_structure(evidence, point.vehicle, r, mounting.noise, q.settings.seed,
                       q.settings.false_alarm, q.settings.policy.unexplained)


def _stages(q: DiagnosisSetup, given: Point, points: Sequence[FittedModel],
            named: Sequence[AcceptedEffect], predictor: Predictor, losses: RecordingLosses
            ) -> tuple[Stage, ...]:
    """Return the errors of the given model, of the refitted one, and with each effect more."""
    labels = ["refitted" if q.refit else q.model, *(effect_label(n.effect) for n in named)]
    stages = [_stage(q, label, p, (vehicle_for_log(q, p), predictor(p)[1]), losses)
              for label, p in zip(labels, points, strict=True)]
    base = [_stage(q, q.model, given, (q.base, q.base), losses)] if q.refit else []
    return tuple(base + stages)


def _stage(q: DiagnosisSetup, label: str, point: FittedModel, vehicles: tuple[Vehicle, Vehicle],
           losses: RecordingLosses) -> Stage:
    """Return one stage; vehicles: as written to a file, and as it predicts from the test logs."""
    r = q.test.evidence.residuals(point.vehicle, losses.timing(point))
    return Stage(label, vehicles[0], q.test.horizons(vehicles[1], r), r)


def _find_confounders(q: DiagnosisSetup, found: SearchResult, named: Sequence[AcceptedEffect]
                      ) -> list[AcceptedEffect]:
    """Find the confounders of the accepted effects; it is slow, so of these alone."""
    by_effect = {one.effect: one for one in each(found.add_confounders, named, q.settings.jobs)}
    return [by_effect[one.effect] for one in named]


def _make_cause(q: DiagnosisSetup, named: AcceptedEffect, last: Point, final: FinalFit,
                accepted: AcceptedEffects, gain: ErrorReduction) -> Cause:
    """Make a cause with its final numbers.

    last: the fit to which its sizes by recording are relative. They are converted to the final one.
    """
    effect = catalogue()[named.effect]
    numbers = {}
    for parameter in effect.parameters:
        key = f"{effect.name}.{parameter.name}"
        size = float(value(final.vehicle, key))
        numbers[parameter.name] = ParameterEstimate(
            size, error_of_size(size - parameter.null, final.stds[key]), parameter.unit,
            parameter.null)
    grade = accepted.grades[effect.name]
    cost = accepted.costs[effect.name]
    first = effect.parameters[0]
    share = ((float(value(last.vehicle, f"{effect.name}.{first.name}")) - first.null)
             / (numbers[first.name].value - first.null or math.nan))
    sizes = [(share * size, abs(share) * error) for size, error in grade.sizes]
    return Cause(effect.name, effect.title, effect.stage, numbers, named.p_value, named.gain,
                 _describe_evidence(q, named, numbers, gain, cost), gain, named.confounders,
                 effect.experiment, grade.probability,
                 dict(zip(q.train.names, sizes, strict=True)),
                 accepted.constancy[effect.name], cost)


def _describe_evidence(q: DiagnosisSetup, named: AcceptedEffect,
                       numbers: Mapping[str, ParameterEstimate], gain: ErrorReduction, cost: Cost
                       ) -> tuple[str, ...]:
    """Describe the evidence for a cause in sentences."""
    key, number = max(numbers.items(), key=lambda kn: abs(kn[1].value - kn[1].null)
                      / max(kn[1].std, 1e-12))
    away = abs(number.value - number.null) / max(number.std, 1e-12)
    return (
        f"robust loss {named.gain:.0f} lower on the training recordings; if nothing were missing, "
        f"chance would lower it by more than {named.threshold:.0f} in "
        f"{100.0 * q.settings.false_alarm:g} % of such recordings (the best of all effects, on the "
        "scale of this one)",
        f"{key} is {away:.0f} standard errors from its null",
        f"errors on the test recordings are {describe_change(*cost)} without it",
        f"{gain.measure}: {removes(gain)}")


def _find_claims(q: DiagnosisSetup, last: Point, final: FinalFit, losses: RecordingLosses
                 ) -> tuple[Claim, ...]:
    """Find parameters of the base model that were wrong, at the final model."""
    settings = q.settings
    if losses.last is not last:
        losses = RecordingLosses(q.test.evidence, last, settings.policy)
    linear = secants(q.train.evidence, last, ())
    groups = GroupFits(q.train.evidence, q.base, last, linear.unit, settings.known,
                       settings.policy, settings.joint)
    return find_claims(ClaimInputs(groups, losses, linear, final, vehicle_for_log(q, final),
                                   settings.seed))


def _list_parameter_changes(q: DiagnosisSetup, final: FinalFit) -> dict[str, ParameterChange]:
    """List the base parameters after the refit, including those of effects of the base."""
    own = {f"{a.name}.{k.name}" for a in q.base.effects for k in a.effect.parameters}
    point = final.point
    space = point.space
    if not q.refit:
        return {}
    out = {}
    logged = vehicle_for_log(q, final)
    for i, name in enumerate(space.names):
        if name not in q.settings.free and name not in own:
            continue
        # A delay or lag of 0 is on its lower bound in many a car, and so is the amplitude of a
        # straight line of the steering on its upper one: that is no reason for doubt.
        if is_straight(name.removeprefix("steering."), asdict(logged.steering)):
            doubt = ""
        elif ((point.x[i] - space.low[i] < FIT_ON_BOUND and value(logged, name) > 0.0)
                or space.high[i] - point.x[i] < FIT_ON_BOUND):
            doubt = AT_BOUND
        elif abs(point.x[i]) > q.settings.policy.prior.max_stated_stds:
            doubt = f"{abs(point.x[i]):.1f} prior standard deviations from where it was"
        else:
            doubt = ""
        out[name] = ParameterChange(float(value(q.base, name)), float(value(logged, name)),
                                    final.stds[name], unit(q.base, name), doubt)
    return out


def _take_errors_of_claims(changes: Mapping[str, ParameterChange], claims: Sequence[Claim]
                           ) -> dict[str, ParameterChange]:
    """Return the changes with the errors of the claims, which do without contradicted priors."""
    stds = {name: std for claim in claims for name, std in claim.stds.items()}
    return {name: replace(change, std=max(change.std, stds.get(name, 0.0)))
            for name, change in changes.items()}


def _find_correlation(final: FinalFit, changes: Mapping[str, ParameterChange]
                      ) -> tuple[tuple[str, ...], FloatArray] | None:
    """Return the names of the refitted parameters that have an error, and their correlations."""
    space = final.point.space
    variance = dict(zip(space.names, np.diag(final.covariance), strict=False))
    names = tuple(name for name in changes if variance.get(name, 0.0) > 0.0
                  and np.isfinite(changes[name].std))
    return (names, space.correlation(names, final.covariance)) if names else None


def _list_possible(found: SearchResult, accepted: AcceptedEffects, q: DiagnosisSetup
                   ) -> tuple[Possible, ...]:
    """List effects that are not accepted but possible, the most probable first."""
    policy = q.settings.policy.grade
    loss = {n.effect: n.gain for n in found.accepted}
    ordered = sorted(accepted.rejected.items(), key=lambda item: -item[1].probability)
    return tuple(Possible(name, catalogue()[name].title, one.probability, loss[name], one.why,
                          "likely" if one.probability >= policy.likely_probability else "possible")
                 for name, one in ordered if one.probability >= policy.possible_probability)


def _list_considered(found: SearchResult, withdrawn: Sequence[str], accepted: AcceptedEffects
                     ) -> tuple[Considered, ...]:
    """List all effects that are not accepted, with the reason."""
    out = [Considered(n.effect, n.p_value, n.gain, WITHDRAWN)
           for n in found.accepted if n.effect in withdrawn]
    out += [Considered(n.effect, n.p_value, n.gain,
                       f"not accepted, with probability "
                       f"{accepted.rejected[n.effect].probability:.2f}: "
                       f"{accepted.rejected[n.effect].why}")
            for n in found.accepted if n.effect in accepted.rejected]
    return (*out, *(Considered(r.effect, r.p_value, r.gain, r.reason)
                    for r in found.rejected if r.effect not in withdrawn))


def _verdict(q: DiagnosisSetup, found: SearchResult, causes: Sequence[Cause],
             findings: Sequence[Finding],
             gain: Mapping[str, ErrorReduction], claims: Sequence[Claim],
             possible: Sequence[Possible]) -> str:
    """Return one of VERDICTS."""
    changes = not (all(c.constancy.constant for c in causes) and all(c.constant for c in claims))
    if causes:  # a cause with significantly worse predictions does not explain the errors
        worse = any(c.gain.high < 0.0 for c in causes)
        return "partly_explained" if findings or worse or changes else "explained"
    if findings or changes:
        return "unexplained"
    if claims:
        return "parameters_only"
    if q.refit:
        block = label_point_rows(q.train.evidence, found.base).block
        p = refit_p_value(found.base, found.refit_loss, block, q.settings.seed)
        better = not gain or any(g.low > 0.0 for g in gain.values())
        if (p < q.settings.false_alarm and better
                and not list_worse_channels(gain)):
            return "parameters_only"
    # The search has found something, which happens in 1 of 100 faultless cars.
    return "unexplained" if possible else "nothing_wrong"
