"""Evaluation of one model on some recordings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dart_hal.core.process.jobs import each
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.compose import apply_parameter_effects, signals
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.battery import state_fade_law
from dart_lab.identification.drive_form import check_drive
from dart_lab.identification.prediction.rollout import Progress
from dart_lab.identification.prediction.windows import HORIZONS

from .cases import Prepared, correct_poses, prepare
from .compare import Gain, gains
from .prediction import errors, measured, predict, predict_ctrv
from .scores import Score, score
from .validity import KinematicLimit, kinematic_limit


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Errors of one model and of constant velocity (CTRV), on the same windows.

    fitted_to: keys of the recordings that the model was fitted to. Its errors on these are no
    estimate of its errors on others. notes: parts of the model that do not fit the recordings.
    """

    vehicle: Vehicle
    prepared: Prepared
    model: Score
    ctrv: Score
    limit: KinematicLimit | None
    fitted_to: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def gain_over_ctrv(self, horizon: float = 1.0) -> dict[str, Gain]:
        """Compute by channel the RMSE reduction over constant velocity, with its interval."""
        return gains(self.ctrv.errors, self.model.errors, self.prepared.cases, horizon=horizon)

    def to_json(self) -> dict[str, Any]:
        """As ``dart-hal evaluate --json`` prints it."""
        cases = self.prepared.cases
        over = {f"{h:.1f}": {name: g.to_json() for name, g in self.gain_over_ctrv(h).items()}
                for h in HORIZONS}
        return {
            "model": self.vehicle.name, "kind": self.vehicle.kind,
            "fitted_to": list(self.fitted_to), "notes": list(self.notes),
            "horizons": self.model.to_json(), "ctrv": self.ctrv.to_json(),
            "gain_over_ctrv": over,
            "kinematic_limit": self.limit.to_json() if self.limit else None,
            "references": {c.file: c.grid.reference.to_json() for c in cases},
            "files": {file: use.to_json() for file, use in self.prepared.files.items()}}


def evaluate(p: Vehicle, recordings: Sequence[Recording], *, reference: Reference | None = None,
             named: Sequence[Path] = (), skipped: Sequence[tuple[str, str]] = (),
             limit: bool = True, fitted_to: Collection[str] = (),
             progress: Progress | None = None) -> Evaluation:
    """Score a model on recordings. limit: also find where its kinematic form ends.

    fitted_to: SHA-256 of the files that the model was fitted to. Other options and errors as for
    ``prepare``, and UsageError for a motor of another form than the recordings; progress(share)
    reports each batch. Effects of the model on motion capture are removed from the measured poses.
    """
    check_drive(recordings, p)
    # An effect may move the centre of mass, at which the grids are computed.
    p = apply_parameter_effects(p)
    prepared = prepare(recordings, l_r=p.body.l_r, reference=reference, named=named,
                       skipped=skipped)
    # As in a diagnosis.
    cases = tuple(correct_poses(p, prepared.cases, p.body.l_r))
    of_poses = [one.name for one, _ in signals(p, "pose")]
    removed = ([f"removed from the measured poses: {', '.join(of_poses)} of the model"]
               if of_poses else [])
    truth = measured(cases)

    def score_states(states: FloatArray) -> Score:
        return score(errors(states, truth), cases)

    share = (lambda done: progress(0.6 * done)) if progress else None
    model = score_states(predict(p, cases, share, each))
    out = Evaluation(p, replace(prepared, cases=cases), model,
                     score_states(predict_ctrv(cases)), None,
                     tuple(c.file for c in cases if c.sha256 and c.sha256 in fitted_to),
                     (*removed, *state_fade_law(p, recordings)))
    return replace(out, limit=kinematic_limit(p, cases)) if limit else out
