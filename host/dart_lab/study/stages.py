"""The stages of a study, each a function from the study and earlier results to its result.

1. check: is each recording whole, and good for a fit?
2. identifiability: which parameters will these recordings determine, and which drive would give
   the others?
3. fit: the start model fitted to the training recordings.
4. validation: start model and fitted model on the test recordings, against constant velocity.
5. diagnosis: what the fitted model gets wrong there, and its physical cause.
6. next: the drive to record next.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.config import ModelFile, load_model, save_model
from dart_hal.core.config.model import Covariance
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.core.plain_json import plain
from dart_hal.core.process.jobs import choose_processes
from dart_hal.recording.check import RecordingCheck, check
from dart_hal.recording.dart import Recording
from dart_hal.recording.dart.one_car import caution_several_cars, refuse_several_cars
from dart_hal.recording.dart.steering_sign import refuse_reversed_steering
from dart_hal.vehicle.flat import replace_unchecked, value
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.motion import driving_seconds
from dart_lab.diagnosis.parameters.groups import make_groups
from dart_lab.diagnosis.policy import USUAL
from dart_lab.diagnosis.report import write_page
from dart_lab.diagnosis.report.data_problems import data_problems
from dart_lab.diagnosis.report.explain import describe_cause
from dart_lab.diagnosis.report.next_drive import NOTHING_TO_SUGGEST
from dart_lab.diagnosis.report.summary import first_step, headline, summary_lines
from dart_lab.diagnosis.split import hold_out
from dart_lab.diagnosis.suggest import suggest, suggest_parameter_drives
from dart_lab.diagnosis.write import write_model
from dart_lab.identification.drive_form import with_drive_of
from dart_lab.identification.evaluation import evaluate
from dart_lab.identification.outcome import identify_jointly, identify_per_recording
from dart_lab.identification.shooting.identifiability import predict_identifiability
from dart_lab.identification.write import SECTIONS, build_model
from dart_lab.report.numbers import significant

STAGES = {
    "check": "are the recordings whole, and good for a fit?",
    "identifiability": "which parameters do these recordings determine?",
    "fit": "the model fitted to the training recordings",
    "validation": "start model and fitted model on the test recordings",
    "diagnosis": "what the fitted model gets wrong, and why",
    "next": "the drive to record next",
}
# Share of the recordings that test, by number and start time: the last third.
TEST_SHARE = 1.0 / 3.0
# Standard errors that a fit changes a quantity by at least, to be described: by chance 1 in 22. How
# many of them are in the verdict: what fits into two lines.
MIN_CHANGE_STDS = 2.0
MOST_LEARNT = 3
# Of a derivative, where a parameter is on its bound and has no standard error.
SMALLEST_STEP = 1e-9
# Horizon [s] at which the errors of a stage are stated.
HORIZON = 1.0
# Channels of an evaluation, in words.
CHANNEL_LABELS = {"vx": "speed [m/s]", "vy": "lateral velocity [m/s]",
                  "yaw_rate": "yaw rate [rad/s]", "position": "position [m]",
                  "yaw_deg": "yaw angle [deg]"}
FITTED_MODEL = "model.toml"
EXTENDED_MODEL = "extended.toml"
DIAGNOSIS_PAGE = "diagnosis.html"

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class Study:
    """What a study works on.

    folder: of its results. recordings: all, with their marker frames. start: start model with the
    sizes of the car. notes: assumptions, to be shown on the page. seed: of random draws.
    """

    folder: Path
    recordings: tuple[Recording, ...]
    start: ModelFile
    notes: tuple[str, ...] = ()
    seed: int = 0

    @property
    def has_poses(self) -> bool:
        """Whether the recordings that count have poses."""
        return any(r.mocap is not None for r in self.recordings)


@dataclass(frozen=True, slots=True)
class StageResult:
    """Result of a stage.

    verdict: one sentence. lines: what follows, a sentence each. rows: a table with its head as the
    first row, empty without one. facts: for programs. sound: the next stage makes sense.
    """

    stage: str
    verdict: str
    lines: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    facts: Mapping[str, Any] | None = None
    sound: bool = True

    def save(self, folder: Path) -> Path:
        """Write the result as JSON into the folder of the study. Raises OSError."""
        path = folder / f"{list(STAGES).index(self.stage) + 1}_{self.stage}.json"
        path.write_text(json.dumps(plain(asdict(self)), indent=1), encoding="utf-8")
        return path


def load_results(folder: Path) -> dict[str, StageResult]:
    """Read the results of the stages that were run. Raises RecordingError for a damaged one."""
    found = {}
    for number, stage in enumerate(STAGES, 1):
        path = folder / f"{number}_{stage}.json"
        if not path.is_file():
            continue
        try:
            saved = json.loads(path.read_text(encoding="utf-8"))
            found[stage] = StageResult(
                saved["stage"], saved["verdict"], tuple(saved["lines"]),
                tuple(tuple(row) for row in saved["rows"]), saved["facts"], saved["sound"])
        except (ValueError, LookupError, TypeError) as why:
            raise RecordingError(f"{path}: the result of this stage is damaged", found=repr(why),
                                 read=str(path), remedy=f"run it again: --stage {stage}") from why
    return found


def split_recordings(recordings: Sequence[Recording]
                     ) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Return (training, test) recordings: the last third tests, of one recording its stretches."""
    # The last recordings test: the model is for drives after those that it was fitted to.
    if len(recordings) == 1:
        train, test = hold_out(recordings, USUAL.inputs.test_share)
        return tuple(train), tuple(test)
    ordered = sorted(recordings, key=lambda r: (r.when.timestamp() if r.when else 0.0,
                                                str(r.path)))
    cut = len(ordered) - max(math.floor(TEST_SHARE * len(ordered) + 0.5), 1)
    return tuple(ordered[:cut]), tuple(ordered[cut:])


def run_stage(study: Study, stage: str, progress: Progress | None = None) -> StageResult:
    """Run one stage and save its result in the folder of the study.

    Raises UsageError for an unknown stage or one whose model is missing, RecordingError for
    recordings that cannot be used.
    """
    if stage not in STAGES:
        raise UsageError(f"no stage {stage!r}", found=stage, expected=", ".join(STAGES))
    result = _RUNNERS[stage](study, progress)
    result.save(study.folder)
    return result


def _check(study: Study, progress: Progress | None) -> StageResult:
    """Check each recording."""
    checks = [check(r) for r in study.recordings]
    rows = [("recording", "s", "good for", "first finding")]
    for c in checks:
        # The table has one finding for each recording; the page of data check has all.
        serious = [f.text for f in c.findings if f.serious] or [""]
        rows.append((c.name, f"{c.facts.duration:.0f}", ", ".join(c.good_for) or "nothing",
                     serious[0]))
    good = [c for c in checks if _is_usable(c)]
    # One study is of one car: the fits of all stages pool its recordings.
    refuse_several_cars(study.recordings)
    refuse_reversed_steering(study.recordings)
    train, test = split_recordings([c.recording for c in good]) if good else ((), ())
    seconds = sum(c.facts.duration for c in good)
    lines = [f"{c.name} is not used: {_explain_unusable(c)}" for c in checks if c not in good]
    lines += study.notes
    lines += caution_several_cars(study.recordings)
    if good:
        lines.append(f"train: {', '.join(r.name for r in train)}; test: "
                     f"{', '.join(r.name for r in test)}"
                     + (", other stretches of the same recording" if len(good) == 1 else ""))
    if not study.has_poses:
        lines.append("no poses: position, side slip and the limit of the tyres cannot be known")
    return StageResult(
        "check", f"{len(good)} of {len(study.recordings)} recordings are good for a study, "
        f"{seconds:.0f} s", tuple(lines), tuple(rows),
        {"recordings": [c.to_json() for c in checks]}, bool(good))


def _is_usable(c: RecordingCheck) -> bool:
    """Return whether a recording is good for something, and the frame of its poses is known."""
    r = c.recording
    return bool(c.good_for) and (r.mocap is None or r.marker is not None)


def _explain_unusable(c: RecordingCheck) -> str:
    """Return why ``_is_usable`` refuses a recording."""
    frames = [f.text for f in c.findings if f.kind == "reference_unknown"]
    return frames[0] if c.good_for and frames else c.verdict


def _select_usable(study: Study) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Return (training, test) recordings of those that are good for something."""
    good = [r for r in study.recordings if _is_usable(check(r))]
    if not good:
        raise RecordingError("no recording is good for a study",
                             found=", ".join(r.name for r in study.recordings),
                             expected="driving with poses, or with encoder and gyro",
                             remedy="dart-hal data check FILES gives the reasons")
    # Poses determine more parameters than sensors. Both kinds in one fit would need weights between
    # them, so recordings without poses are left out where others have them.
    if any(r.mocap is not None for r in good):
        good = [r for r in good if r.mocap is not None]
    return split_recordings(good)


def _start_model(study: Study, train: Sequence[Recording]) -> ModelFile:
    """Return the start model with the motor form of the recordings."""
    return with_drive_of(study.start, train, SECTIONS)


def _predict(study: Study, progress: Progress | None) -> StageResult:
    """Predict which parameters the training recordings determine."""
    train, _ = _select_usable(study)
    if train[0].mocap is None:
        return StageResult("identifiability", "without poses it is known only after the fit")
    # Standard errors at the start values: before a fit they are predictions.
    found = predict_identifiability(train, vehicle_of(_start_model(study, train)))
    rows = [("parameter", "start value", "predicted error", "unit", "determined")]
    rows += [(i.name, f"{i.value:.3g}", f"{i.std:.2g}", i.unit, "yes" if i.determined else "no")
             for i in found]
    unknown = [i for i in found if not i.determined]
    # One drive for a group of parameters: they are determined by the same motion.
    drives = {i.name.partition(".")[0]: i.manoeuvre for i in unknown}
    lines = [f"{group} needs: {manoeuvre}" for group, manoeuvre in drives.items()]
    # Parameters that are determined together alone predict as well, so the study goes on.
    return StageResult(
        "identifiability", f"{len(found) - len(unknown)} of {len(found)} parameters will be "
        "determined one by one; the others only together", tuple(lines), tuple(rows),
        {"parameters": [asdict(i) for i in found]})


def _fit(study: Study, progress: Progress | None) -> StageResult:
    """Fit the start model to the training recordings, and write it."""
    train, _ = _select_usable(study)
    command = f"dart-hal study: stage fit, seed {study.seed}"
    # With poses the sub-models are fitted together, by rollouts; without, one after the other.
    if train[0].mocap is not None:
        outcome, _ = identify_jointly(list(train), [], SECTIONS, study.start, command, None,
                                      progress)
    else:
        outcome, _ = identify_per_recording(list(train), [], SECTIONS, vehicle_of(study.start),
                                            command, None, progress)
    written = build_model(outcome.fits, outcome.over(study.start), outcome.source,
                          joint=outcome.joint)
    if written.model is None:
        return StageResult("fit", "no sub-model could be fitted",
                           tuple(f"{name}: {why}" for name, why in written.left_out.items()),
                           (), outcome.to_json(), False)
    save_model(written.model, study.folder / FITTED_MODEL)
    rows = [("parameter", "fitted", "error", "unit", "identifiable")]
    for name, fit in outcome.fits.items():
        rows += [(f"{name}.{key}", f"{e.value:.4g}", f"{e.std:.2g}", e.unit,
                  "yes" if e.identifiable else "no") for key, e in fit.parameters.items()]
    notes = list(dict.fromkeys(note for fit in outcome.fits.values() for note in fit.notes))
    learnt = describe_changes(vehicle_of(_start_model(study, train)), vehicle_of(written.model),
                              outcome.joint)
    most = "; learnt most: " + "; ".join(learnt[:MOST_LEARNT]) if learnt else ""
    return StageResult("fit", f"fitted: {', '.join(written.sections)}{most}", (
        *learnt[MOST_LEARNT:], *notes,
        *(f"{name} was left out: {why}" for name, why in written.left_out.items()),
        f"written: {study.folder / FITTED_MODEL}"), tuple(rows), outcome.to_json())


def describe_changes(start: Vehicle, fitted: Vehicle, joint: Covariance | None) -> list[str]:
    """Describe what a fit changed in quantities that a workshop knows, most significant first.

    joint: covariance of the fitted parameters; without one, nothing is described.

    Example:
        >>> describe_changes(start, fitted, fit.joint)[0]
        'steering map: angle straight on 0.63 -> 3.14 +- 0.17 deg'
    """
    if joint is None:
        return []
    covariance = np.array(joint.matrix)
    at = {name: value(fitted, name) for name in joint.names}
    # Steps of a thousandth of the standard error, upwards: a delay may be at its bound of 0. They
    # are unchecked, because another parameter may be at its upper bound.
    steps = np.maximum(1e-3 * np.sqrt(np.diag(covariance)), SMALLEST_STEP)
    moved = [replace_unchecked(fitted, {group: {key: at[name] + step}})
             for name, step in zip(joint.names, steps, strict=True)
             for group, _, key in (name.partition("."),)]
    found = []
    for group in make_groups(find_scale(fitted.body).speed).values():
        for name, (unit, quantity) in group.quantities.items() if group.select(joint.names) else ():
            before = quantity(start)
            after = quantity(fitted)
            slope = (np.array([quantity(vehicle) for vehicle in moved]) - after) / steps
            std = math.sqrt(slope @ covariance @ slope)
            if abs(after - before) > MIN_CHANGE_STDS * std:
                found.append((abs(after - before) / std, f"{group.title}: {name} {before:.3g} -> "
                              f"{after:.3g} +- {std:.2g}{'' if unit == '-' else ' ' + unit}"))
    return [text for _, text in sorted(found, reverse=True)]


def _load_fitted_model(study: Study) -> ModelFile:
    path = study.folder / FITTED_MODEL
    if not path.is_file():
        raise UsageError("there is no fitted model yet", found=f"no {path}",
                         expected="the result of the stage fit", remedy="run it: --stage fit")
    return load_model(path)


def _validate(study: Study, progress: Progress | None) -> StageResult:
    """Compare start model and fitted model on the test recordings."""
    train, test = _select_usable(study)
    if test[0].mocap is None:
        return StageResult("validation", "without poses the diagnosis alone compares predictions")
    models = {"start": _start_model(study, train), "fitted": _load_fitted_model(study)}
    results = {name: evaluate(vehicle_of(model), test, limit=False)
               for name, model in models.items()}
    key = f"{HORIZON:.1f}"
    pooled = {name: r.model.to_json()[key]["pooled"] for name, r in results.items()}
    # Constant velocity and yaw rate: what a prediction without any model reaches.
    pooled["constant velocity"] = results["fitted"].ctrv.to_json()[key]["pooled"]
    rows = [("error (rms)", *pooled)]
    rows += [(label, *(f"{values[channel]:.3g}" for values in pooled.values()))
             for channel, label in CHANNEL_LABELS.items()]
    better = [c for c in CHANNEL_LABELS if pooled["fitted"][c] < pooled["start"][c]]
    beaten = [c for c in CHANNEL_LABELS if pooled["fitted"][c] >= pooled["constant velocity"][c]]
    lines = ["constant velocity predicts "
             f"{', '.join(CHANNEL_LABELS[c] for c in beaten)} better than the fitted model"] \
        if beaten else []
    return StageResult(
        "validation", f"the fit lowers the error in {len(better)} of {len(rows) - 1} channels, "
        f"{HORIZON:g} s ahead on the test recordings", tuple(lines), tuple(rows),
        {"pooled": pooled})


def describe_validation(result: StageResult) -> str:
    """Return the errors of start model and fitted model: "speed 0.3 -> 0.1 m/s"; "" without."""
    if result.facts is None:
        return ""
    # The stage without a fit on held-out recordings has no facts. A label is "speed [m/s]".
    pooled = result.facts["pooled"]
    parts = [f"{label.partition(' [')[0]} {significant(pooled['start'][channel])} -> "
             f"{significant(pooled['fitted'][channel])} {label.partition(' [')[2][:-1]}"
             for channel, label in CHANNEL_LABELS.items()]
    return (f"errors {HORIZON:g} s ahead on the test recordings, start model -> {FITTED_MODEL}: "
            f"{', '.join(parts)}")


def _diagnose(study: Study, progress: Progress | None) -> StageResult:
    """Find what the fitted model gets wrong; write the extended model, the report, the next drives.
    """
    train, test = _select_usable(study)
    file = _load_fitted_model(study)
    vehicle = vehicle_of(file)
    # A single recording is split by the diagnosis itself, so it gets all of it.
    one = len({r.sha256 for r in (*train, *test)}) == 1
    whole = [replace(train[0], spans=())] if one else list(train)
    inputs = check_inputs(whole, () if one else test, vehicle)
    d = diagnose(file, vehicle, inputs.train, inputs.test, seed=study.seed, progress=progress,
                 jobs=choose_processes(sum(map(driving_seconds, inputs.train))))
    written = write_model(d, study.folder / EXTENDED_MODEL, file, inputs.train,
                          "dart-hal study: stage diagnosis")
    d = replace(d, model=FITTED_MODEL, notes=(*study.notes, *d.notes, *inputs.notes),
                written=str(written))
    suggestions = suggest(d, seed=study.seed, model=file)
    drives = suggest_parameter_drives(d, model=file)
    write_page(d, study.folder / DIAGNOSIS_PAGE, command="dart-hal study",
               suggestions=suggestions, drives=drives)
    causes = [f"{c.effect}: {' '.join(list(describe_cause(d, i).values())[:3])}"
              for i, c in enumerate(d.causes)]
    sentences = dict.fromkeys([*(s.sentence() for s in suggestions),
                               *(p.sentence() for p in drives)])
    return StageResult("diagnosis", headline(d), (*summary_lines(d), *causes,
                                                  f"report: {DIAGNOSIS_PAGE}"), (),
                       {**d.to_json(), "next_drives": list(sentences),
                        "first_step": first_step(d) if data_problems(d) else ""})


def _suggest(study: Study, progress: Progress | None) -> StageResult:
    """Name the drive that would sharpen the result most, as the diagnosis found it."""
    _load_fitted_model(study)
    diagnosis = load_results(study.folder).get("diagnosis")
    if diagnosis is None or diagnosis.facts is None:
        raise UsageError("there is no diagnosis yet", found=f"no result in {study.folder}",
                         expected="the result of the stage diagnosis",
                         remedy="run it: --stage diagnosis")
    # A problem of the data comes before any other drive.
    first = diagnosis.facts.get("first_step", "")
    sentences = tuple(filter(None, (first, *diagnosis.facts["next_drives"]))) or (
        NOTHING_TO_SUGGEST,)
    # What the fit lacks is worth a drive, whether or not the diagnosis needs one.
    prediction = load_results(study.folder).get("identifiability")
    lacks = () if prediction is None else prediction.lines
    return StageResult("next", sentences[0], (*sentences[1:], *lacks), (),
                       {"drives": list(diagnosis.facts["next_drives"])})


_RUNNERS: Mapping[str, Callable[[Study, Progress | None], StageResult]] = {
    "check": _check, "identifiability": _predict, "fit": _fit, "validation": _validate,
    "diagnosis": _diagnose, "next": _suggest}
