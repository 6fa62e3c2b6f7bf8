"""The whole diagnosis: what a model gets wrong on recordings, why, and what that is worth."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from dart_hal.core.config import ModelFile, Quantity
from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.flat import value
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.cases import prepare as prepare_cases
from dart_lab.identification.shooting.fit import FREE, free_names

from .conclude import conclude
from .evidence.drive import READ_OUTS, START_SPACING, WINDOW_SPACING, prepare_drive
from .evidence.residuals import Evidence
from .frames import find_frame_errors, free_frame
from .gains import Side, side_of
from .pace import Pace
from .parameters.unseen import Unseen
from .paths import find_paths
from .policy import USUAL, EvidencePolicy, Policy
from .predictor import check_recordings
from .question import Question
from .result import Diagnosis
from .search.forward import ForwardSearch, SearchResult
from .search.scan import Progress
from .search.selection import Settings

FITTED, SEARCHING = 0.15, 0.65  # of the time, about, until the model is fitted, and causes found
EVALUATIONS = (150, 1500, 500)  # of a fit of the base, a search, and a conclusion, about


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
    refit: the parameters of the model are estimated anew before anything is
    called a missing effect, from where the file says and within the standard
    errors that it states. only: effects that may be named; () = all.
    false_alarm: probability that anything is named where nothing is missing.
    jobs: processes; the result does not depend on it as long as linear algebra has one
    thread, as the command line gives it. reference: marker frame
    of the mocap; None: known or fitted, see ``with_marker_frames``. policy: its thresholds.
    predictor: look for the best predictor too, see ``find_predictor``. progress(share, what).
    Errors: RecordingError for recordings that hold nothing to predict; UsageError for a predictor
    without a refit, or of fewer than three training recordings with motion capture.
    """
    began = time.monotonic()
    if predictor and not refit:
        raise UsageError("a predictor needs a refit", found="--no-refit",
                         expected="a predictor estimates all parameters again, effects and "
                                  "numbers together",
                         remedy="leave out --no-refit, or leave out --out-predictor")
    l_r = settled(vehicle).body.l_r
    known = standard_errors(model) if refit else {}
    files: dict[str, dict[str, Any]] = {}
    sides = [_side(role, recordings, l_r, reference, policy.evidence, files)
             for role, recordings in (("train", train), ("test", test))]
    if predictor:
        check_recordings(sides[0])
    free = _estimated(vehicle, known, sides[0].evidence.has_mocap) if refit else ()
    frame = find_frame_errors([d.recording for side in sides for d in side.evidence.drives])
    known, vehicle = {**known, **frame}, free_frame(vehicle, frame)
    settings = Settings(free=free, known=known, names=tuple(only), false_alarm=false_alarm,
                        max_causes=max_causes, jobs=jobs, seed=seed,
                        policy=policy, refit=refit)

    pace = Pace(progress)
    for side in sides:
        side.evidence.on_evaluation = pace.step
    pace.phase(FITTED, "fitting the model", EVALUATIONS[0])

    def tell(share: float, what: str) -> None:
        pace.at(FITTED + (SEARCHING - FITTED) * share, what)

    search = ForwardSearch(sides[0].evidence, vehicle, settings, tell,
                    lambda: pace.phase(SEARCHING, "looking for causes", EVALUATIONS[1]))
    found = search.run()
    pace.phase(1.0, "measuring the gain", EVALUATIONS[2])
    question = Question(model.name, vehicle, sides[0], sides[1], settings, refit, search, predictor,
                        tuple(frame))
    return _with_paths(conclude(question, found, files, began), question, found)


def _with_paths(d: Diagnosis, q: Question, found: SearchResult) -> Diagnosis:
    """Add the paths of single test windows, by models that count delays as the table of errors."""
    models = {name: stage.vehicle for name, stage in d.compared.items()}
    if not q.refit and q.test.prepared is not None:
        timing = Unseen(q.test.evidence, found.point, q.settings.policy).timing(found.point)
        models = {name: timing.shift_delays(p) for name, p in models.items()}
    return replace(d, paths=find_paths(q.test, models, "refitted" if q.refit else "given"))


def standard_errors(model: ModelFile) -> dict[str, float]:
    """By name, of the parameters that the file states with one."""
    return {f"{group}.{key}": float(entry.std) for group in FREE
            for key, entry in getattr(model, group).items()
            if isinstance(entry, Quantity) and entry.std}


def _estimated(vehicle: Vehicle, known: Mapping[str, float], exact: bool) -> tuple[str, ...]:
    """Parameters that a refit moves.

    All of them, where the file states no standard error at all. Where it does, a
    delay or lag of 0 without one is none: a model that has no lag has no parameter
    for it, and if the car has one, that is a cause with a name. Without motion
    capture (not ``exact``) it moves even so: a lag of a tenth of a second cannot be
    distinguished from commands that are logged with the next message.
    """
    return tuple(name for name in free_names(vehicle, tuple(FREE))
                 if not (exact and known) or name in known or value(vehicle, name) != 0.0)


def _side(role: str, recordings: Sequence[Recording], l_r: float, reference: Reference | None,
          policy: EvidencePolicy, files: dict[str, dict[str, Any]]) -> Side:
    # by content: sums in another order end a descent elsewhere, and that may change a name
    ordered = sorted(recordings, key=lambda r: r.sha256)
    evidence, windows = evidence_of(ordered, l_r, reference, policy)
    count = {r.sha256: n for r, n in zip(ordered, windows, strict=True)}
    for r in recordings:
        entry: Mapping[str, Any] = {"role": role, "windows": count[r.sha256], "sha256": r.sha256,
                                    "reference": r.marker and r.marker.to_json(),
                                    "why": [str(note) for note in r.notes]}
        name = r.name if r.name not in files else f"{r.name} ({role})"
        files[name] = dict(entry)
    return side_of(evidence, ordered, l_r, reference)


def evidence_of(recordings: Sequence[Recording], l_r: float, reference: Reference | None = None,
                policy: EvidencePolicy = USUAL.evidence) -> tuple[Evidence, list[int]]:
    """(evidence, number of windows of each recording); all with motion capture, or all without."""
    if any(r.mocap is None for r in recordings):
        from .evidence.onboard import OnboardEvidence
        from .evidence.onboard_drive import prepare_stretches

        parts = [prepare_stretches(r, policy) for r in recordings]
        return (OnboardEvidence([o for part in parts for o in part], l_r),
                [sum(len(o.starts) for o in part) for part in parts])
    cases = prepare_cases(recordings, l_r=l_r, reference=reference)
    frames = {c.sha256: c.grid.reference for c in cases.cases}
    seconds = sum(len(c.grid) for c in cases.cases) * SAMPLE
    every = WINDOW_SPACING if seconds > policy.whole_s else START_SPACING
    drives = [prepare_drive(r, l_r, frames[r.sha256], every, policy)
              for r in recordings if r.sha256 in frames]
    windows = {r.sha256: len(d.starts) for d in drives for r in [d.recording]}
    return (Evidence(drives, l_r, READ_OUTS[-1] / every),
            [windows.get(r.sha256, 0) for r in recordings])
