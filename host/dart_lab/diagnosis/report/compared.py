"""Errors on the test recordings before and after a step, and in how many of them it improves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_lab.diagnosis.result import Diagnosis, Stage, effect_label
from dart_lab.identification.evaluation import CHANNELS as PREDICTED
from dart_lab.identification.evidence.residuals import Evidence

from .words import error_figure

HORIZON = "1.0"  # s
# Share by which an error must change for a recording to count as better or worse.
MIN_ERROR_CHANGE = 0.01


@dataclass(frozen=True, slots=True)
class ErrorChange:
    """RMSE of one channel before and after a step, and the number of recordings by direction.

    recordings: of both. when: " 1 s ahead" for predictions, " at standstill" for readings of a
    car at rest, else "".
    """

    before: float
    after: float
    better: int
    worse: int
    recordings: int
    when: str = ""

    @property
    def ratio(self) -> float:
        """Error after over error before; NaN where one of the two is not known."""
        known = math.isfinite(self.after) and self.before > 0.0
        return self.after / self.before if known else math.nan

    @property
    def share(self) -> str:
        """"-73 %", "+4 %", "0 %"; "-" where one of the two is not known."""
        if math.isnan(self.ratio):
            return "-"
        rounded = round(100.0 * (self.ratio - 1.0))
        return f"{rounded:+d} %" if rounded else "0 %"

    @property
    def counts(self) -> str:
        """" (9 recordings better, 2 worse)"; "" for a single recording or none that changes."""
        if self.recordings < 2 or not self.better + self.worse:
            return ""
        s = "" if self.better == 1 else "s"
        return f" ({self.better} recording{s} better, {self.worse} worse)"

    @property
    def summary(self) -> str:
        """"-73 % 9:2", with the recordings better:worse where ``counts`` has them."""
        return f"{self.share} {self.better}:{self.worse}" if self.counts else self.share


def error_change(d: Diagnosis, first_stage: Stage, second_stage: Stage,
                 channel: str) -> ErrorChange:
    """Compare two stages in a channel of the evaluation, 1 s ahead, or in readings of a sensor.

    Figures that these recordings do not have are NaN.
    """
    first_error, by_file = _errors(d, first_stage, channel)
    second_error, by_file_after = _errors(d, second_stage, channel)
    ratios = [by_file_after[name] / max(value, 1e-300) for name, value in by_file.items()
              if name in by_file_after]
    return ErrorChange(first_error, second_error, sum(r < 1.0 - MIN_ERROR_CHANGE for r in ratios),
                       sum(r > 1.0 + MIN_ERROR_CHANGE for r in ratios), len(ratios),
                       _when(d.evidence, channel))


def step_changes(d: Diagnosis, channel: str) -> list[ErrorChange]:
    """Compare the model as given with the refitted one, and that with the extended one.

    Empty where the channel is not known; one entry where only one of the steps was made.
    """
    steps = list(d.compared.values())
    changes = [error_change(d, first_stage, second_stage, channel) for first_stage,
               second_stage in pairwise(steps)]
    return [] if any(math.isnan(c.before) or math.isnan(c.after) for c in changes) else changes


def stages_around(d: Diagnosis, i: int) -> tuple[Stage, Stage]:
    """Return the stage before the cause number i and the one with it."""
    index = [s.label for s in d.stages].index(effect_label(d.causes[i].effect))
    return d.stages[index - 1], d.stages[index]


def _errors(d: Diagnosis, stage: Stage, channel: str) -> tuple[float, Mapping[str, float]]:
    """RMSE of all test recordings, and RMSE of each."""
    entries = stage.horizons.get(HORIZON, {}).get("by_file")
    if channel in PREDICTED and entries:
        return error_figure(stage.horizons, HORIZON, channel), {
            name: float(entry[channel]) for name, entry in entries.items()}
    evidence = d.evidence
    column = _column(evidence, channel)
    if column is None:
        return math.nan, {}
    if column >= 0:
        drives = evidence.motion_drive
        residuals = stage.residuals.motion[:, column]
    else:
        drives = evidence.sensor_drive
        residuals = (stage.residuals.sensors / evidence.noise_scale)[:, column]
        at_rest = _standstill(evidence, column)
        residuals = np.where(at_rest | ~at_rest.any(), residuals, np.nan)
    squares = np.square(residuals)
    good = np.isfinite(squares)
    names = {i: evidence.drives[i].recording.name for i in np.unique(drives[good]).tolist()}
    return _root_mean(squares[good]), {
        name: _root_mean(squares[good & np.isin(drives, [i for i, n in names.items()
                                                         if n == name])])
        for name in dict.fromkeys(names.values())}


def _column(evidence: Evidence, channel: str) -> int | None:
    """Return the column of a channel in the residuals: of the motion, or below 0 of the sensors."""
    return {**evidence.columns, **evidence.columns_at(float(HORIZON))}.get(channel)


def _when(evidence: Evidence, channel: str) -> str:
    """Return when the errors of a channel are taken, as in ``ErrorChange``."""
    column = _column(evidence, channel)
    if channel in PREDICTED or column is None or column >= 0:
        return " 1 s ahead"
    return " at standstill" if _standstill(evidence, column).any() else ""


def _standstill(evidence: Evidence, column: int) -> BoolArray:
    """Return the readings (rows,) of a car at rest, which have more weight than the others.

    The accelerometer of a moving car vibrates. At rest the residual is the error of the model, and
    the fits weight it accordingly.
    """
    return np.asarray(evidence.noise_scale[:, column] > 1.0)


def _root_mean(squares: FloatArray) -> float:
    return float(np.sqrt(squares.mean())) if len(squares) else math.nan
