"""The whole diagnosis: what a model gets wrong on recordings, why, and how much that changes."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from dart_hal.core.config import ModelFile, Quantity
from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import value
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_hal.vehicle.sizes import list_stated_errors
from dart_lab.identification.battery import FADE, describe_fade_law, set_motor_voltage
from dart_lab.identification.evaluation.cases import prepare as prepare_cases
from dart_lab.identification.evidence.drive import (
    READ_OUTS,
    START_SPACING,
    WINDOW_SPACING,
    prepare_drive,
)
from dart_lab.identification.evidence.policy import EvidencePolicy
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.shooting.fit import FREE, TYRE_SHAPE_NAMES, free_names
from dart_lab.identification.write import was_fitted_to

from .conclude import conclude
from .frames import find_frame_errors, free_frame
from .gains import RecordingSet, make_recording_set
from .pace import ProgressEstimator
from .parameters.unseen import RecordingLosses
from .paths import find_paths
from .policy import USUAL, Policy
from .predictor import check_recordings
from .question import DiagnosisSetup
from .result import Diagnosis
from .search.forward import ForwardSearch, SearchResult
from .search.scan import Progress
from .search.selection import Settings
from .write import DIAGNOSED

# s of recordings, from which on windows do not overlap: cost
MAX_OVERLAPPED_S = 300.0
AGAIN_NOTE = ("the model was fitted to some of the training recordings: its standard errors are no "
              "prior, because the data would count twice")
# Effects that change a size of the body, by the name of the size.
SAME_AS_SIZE = {"body.mass": "mass", "body.yaw_inertia": "yaw_inertia",
                "body.l_f": "centre_of_mass", "body.l_r": "centre_of_mass"}
# Typical shares of the time until the model is fitted, and until the causes are found.
FIT_SHARE = 0.15
SEARCH_SHARE = 0.65
# Typical numbers of evaluations, for the progress alone.
FIT_EVALUATIONS = 150
SEARCH_EVALUATIONS = 1500
CONCLUSION_EVALUATIONS = 500


def diagnose(model: ModelFile, vehicle: Vehicle, train: Sequence[Recording],
             test: Sequence[Recording], *, refit: bool = True, only: Sequence[str] = (),
             false_alarm: float = 0.01, max_causes: int = 12, jobs: int = 1,
             reference: Reference | None = None, seed: int = 0, policy: Policy = USUAL,
             predictor: bool = False,
             progress: Progress | None = None) -> Diagnosis:
    """Find what the model lacks in the training recordings, and measure it on the test ones.

    The training recordings fit and select; the test recordings report, and can veto an effect.

    model, vehicle: as ``find_model`` gives them. train, test: as
    ``inputs.check_inputs`` gives them: all with motion capture, or all without.
    refit: estimate the parameters of the model before the search for effects, from their values in
    the file and within 3.5 of the standard errors there, unless these come from the same
    recordings, and the sizes of the car that have a standard error in car.toml. Without it they
    keep their values, and an effect is accepted only beyond what the errors explain that a
    diagnosis has stated for them together. only: effects that
    may be accepted; () = all.
    false_alarm: probability that an effect is found where nothing is missing.
    jobs: processes; the result does not depend on it as long as linear algebra has one
    thread, as the command line gives it. reference: marker frame
    of the mocap; None: known or fitted, see ``with_marker_frames``. policy: its thresholds, of a
    car of 1:10.
    predictor: find the best predictor too, see ``find_predictor``. progress(share, what).
    Errors: RecordingError for recordings that hold nothing to predict; UsageError for a predictor
    without a refit, or of fewer than three training recordings with motion capture.
    """
    began = time.monotonic()
    if predictor and not refit:
        raise UsageError("a predictor needs a refit", found="--no-refit",
                         expected="a predictor estimates all parameters again, effects and "
                                  "numbers together",
                         remedy="leave out --no-refit, or leave out --out-predictor")
    policy = policy.at_scale(find_scale(vehicle.body))
    l_r = apply_parameter_effects(vehicle).body.l_r
    stated = standard_errors(model) if refit else {}
    again = was_fitted_to(model, train)
    known = {} if again else stated
    sizes, only = select_free_sizes(list_stated_errors(model) if refit else {}, only)
    files: dict[str, dict[str, Any]] = {}
    sets = [_make_recording_set(role, recordings, l_r, reference, policy.evidence, files)
            for role, recordings in (("train", train), ("test", test))]
    if predictor:
        check_recordings(sets[0])
    free = _select_free_parameters(vehicle, stated, sets[0].evidence.has_mocap) if refit else ()
    free += tuple(sizes)
    vehicle = set_motor_voltage(vehicle, train)
    frame = find_frame_errors([d.recording for part in sets for d in part.evidence.drives])
    known = {**known, **sizes, **frame}
    vehicle = free_frame(vehicle, frame)
    settings = Settings(free=free, known=known, unbounded=tuple(sizes), names=tuple(only),
                        false_alarm=false_alarm, max_causes=max_causes, jobs=jobs, seed=seed,
                        policy=policy, refit=refit,
                        joint=model.covariance.get("joint") if refit and not again else None,
                        stated={} if refit else _select_stated(vehicle, model),
                        stated_together=model.covariance.get(DIAGNOSED))

    pace = ProgressEstimator(progress)
    for part in sets:
        part.evidence.on_evaluation = pace.count_evaluation
    pace.start_phase(FIT_SHARE, "fitting the model", FIT_EVALUATIONS)

    def report_search(share: float, what: str) -> None:
        pace.set_share(FIT_SHARE + (SEARCH_SHARE - FIT_SHARE) * share, what)

    def start_search() -> None:
        pace.start_phase(SEARCH_SHARE, "looking for causes", SEARCH_EVALUATIONS)

    search = ForwardSearch(sets[0].evidence, vehicle, settings, report_search, start_search)
    found = search.run()
    pace.start_phase(1.0, "measuring the gain", CONCLUSION_EVALUATIONS)
    setup = DiagnosisSetup(model.name, vehicle, sets[0], sets[1], settings, refit, search,
                           predictor, tuple(frame))
    d = conclude(setup, found, files, began)
    if refit and stated and again:
        d = replace(d, notes=(*d.notes, AGAIN_NOTE))
    if any(cause.effect == FADE for cause in d.causes):
        d = replace(d, notes=(*d.notes, describe_fade_law(d.extended)))
    return _add_paths(d, setup, found)


def _add_paths(d: Diagnosis, q: DiagnosisSetup, found: SearchResult) -> Diagnosis:
    """Add the paths of single test windows, with delays counted as in the table of errors."""
    models = {name: stage.vehicle for name, stage in d.compared.items()}
    if not q.refit and q.test.prepared is not None:
        losses = RecordingLosses(q.test.evidence, found.point, q.settings.policy)
        timing = losses.timing(found.point)
        models = {name: timing.shift_delays(p) for name, p in models.items()}
    return replace(d, paths=find_paths(q.test, models, "refitted" if q.refit else "given"))


def standard_errors(model: ModelFile) -> dict[str, float]:
    """Return the standard errors of the parameters that the file states with one, by name."""
    return {f"{group}.{key}": float(entry.std) for group in FREE
            for key, entry in getattr(model, group).items()
            if isinstance(entry, Quantity) and entry.std}


def select_free_sizes(stated: Mapping[str, float], only: Sequence[str]
                      ) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the sizes of car.toml that a refit estimates, and the effects to look for.

    stated: standard errors by name; only: as in ``diagnose``. A size and an effect such as
    ``mass`` are the same number, so the effect is not looked for: if the size is wrong, that is a
    finding about car.toml and no cause in the car. The size is fixed if no other effect remains.
    """
    same = {SAME_AS_SIZE[name] for name in stated if name in SAME_AS_SIZE}
    remaining = tuple(name for name in only or catalogue() if name not in same)
    if not same or not remaining:
        return ({} if same else dict(stated)), tuple(only)
    return dict(stated), remaining


def _select_free_parameters(vehicle: Vehicle, known: Mapping[str, float], has_mocap: bool
                            ) -> tuple[str, ...]:
    """Select the parameters that a refit estimates.

    All of them, if the file states no standard error at all. If it does, a parameter of 0 without
    one, in practice a delay or lag, is fixed: the model has no such part, and if the car has one,
    that is a cause. Without motion capture it is estimated nevertheless: a lag of a tenth of a
    second cannot be distinguished from commands that are logged with the next message.
    """
    return tuple(name for name in free_names(vehicle, tuple(FREE))
                 if name.partition(".")[2] not in TYRE_SHAPE_NAMES
                 and (not (has_mocap and known) or name in known
                      or value(vehicle, name) != 0.0))


def _select_stated(vehicle: Vehicle, model: ModelFile) -> dict[str, float]:
    """Return the standard errors of the parameters that a diagnosis has fitted together.

    Not those of ``identify``: of few recordings they are so large that they explain any cause.
    """
    together = model.covariance.get(DIAGNOSED)
    stated = standard_errors(model)
    free = _select_free_parameters(vehicle, stated, has_mocap=True)
    return {name: stated[name] for name in (together.names if together else ())
            if name in stated and name in free}


def _make_recording_set(role: str, recordings: Sequence[Recording], l_r: float,
                        reference: Reference | None, policy: EvidencePolicy,
                        files: dict[str, dict[str, Any]]) -> RecordingSet:
    """Make the evidence of recordings, and their entries in ``files``."""
    # Sorted by content: with sums in another order a fit ends at another point.
    ordered = sorted(recordings, key=lambda r: r.sha256)
    evidence, windows = make_evidence(ordered, l_r, reference, policy)
    count = {r.sha256: n for r, n in zip(ordered, windows, strict=True)}
    for r in recordings:
        entry: Mapping[str, Any] = {"role": role, "windows": count[r.sha256], "sha256": r.sha256,
                                    "reference": r.marker and r.marker.to_json(),
                                    "why": [str(note) for note in r.notes]}
        name = r.name if r.name not in files else f"{r.name} ({role})"
        files[name] = dict(entry)
    return make_recording_set(evidence, ordered, l_r, reference)


def make_evidence(recordings: Sequence[Recording], l_r: float, reference: Reference | None = None,
                policy: EvidencePolicy = USUAL.evidence) -> tuple[Evidence, list[int]]:
    """Return the evidence, and the number of windows of each recording.

    All recordings have motion capture, or none has.
    """
    if any(r.mocap is None for r in recordings):
        from dart_lab.identification.evidence.onboard import OnboardEvidence
        from dart_lab.identification.evidence.onboard_drive import prepare_stretches

        parts = [prepare_stretches(r, policy) for r in recordings]
        return (OnboardEvidence([o for part in parts for o in part], l_r),
                [sum(len(o.starts) for o in part) for part in parts])
    cases = prepare_cases(recordings, l_r=l_r, reference=reference)
    frames = {c.sha256: c.grid.reference for c in cases.cases}
    seconds = sum(len(c.grid) for c in cases.cases) * SAMPLE
    spacing = WINDOW_SPACING if seconds > MAX_OVERLAPPED_S else START_SPACING
    drives = [prepare_drive(r, l_r, frames[r.sha256], spacing, policy)
              for r in recordings if r.sha256 in frames]
    windows = {r.sha256: len(d.starts) for d in drives for r in [d.recording]}
    return (Evidence(drives, l_r, READ_OUTS[-1] / spacing),
            [windows.get(r.sha256, 0) for r in recordings])
