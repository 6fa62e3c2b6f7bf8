"""Errors of a model on recordings, and the gain of one model over another there.

    gain = 1 - RMSE(changed model) / RMSE(reference model)

by channel, on recordings that no fit used. Its 95 % interval is a bootstrap over blocks of
time (or whole recordings), in which both models keep the same windows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import Effect
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.cases import (
    Case,
    Prepared,
    correct_poses,
    prepare,
)
from dart_lab.identification.evaluation.compare import gain, label_blocks
from dart_lab.identification.evaluation.prediction import (
    CHANNELS,
    HORIZON_OFFSETS,
    errors,
    measured,
    predict,
    predict_ctrv,
)
from dart_lab.identification.evaluation.scores import score
from dart_lab.identification.evidence.residuals import SIGNAL_CHANNELS, Evidence, Residuals
from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.identification.prediction.windows import HORIZONS

from .result import ErrorReduction

# s; bootstrap of residuals over laps of some seconds (predictions over 1 s: ``compare.BLOCK_TIME``)
GAIN_BLOCK_S = 10.0
HORIZON_INDEX = HORIZONS.index(1.0)
REST_NOTE = ", one of a standing car counted by how much less it shakes"
ROLLOUT_MEASURE = "open-loop prediction over 1 s from the measured state, "
LOGGED_COMMANDS = "logged commands alone"
AGED_COMMANDS = "logged commands at the age that suits the log"


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSet:
    """Training or test recordings: their evidence, and the cases with motion capture."""

    evidence: Evidence
    prepared: Prepared | None

    @property
    def names(self) -> list[str]:
        """Names of the drives with windows or messages, in the order of the evidence.

        Stretches of one recording are numbered.
        """
        used = np.union1d(self.evidence.motion_drive, self.evidence.sensor_drive)
        plain = [self.evidence.drives[i].recording.name for i in used.tolist()]
        return [name if plain.count(name) == 1 else f"{name} ({plain[:i].count(name) + 1})"
                for i, name in enumerate(plain)]

    def evaluation_windows(self) -> Evidence:
        """Return the evidence of the motion in the windows of the evaluation.

        It has no windows without motion capture.
        """
        cases = self.prepared.cases if self.prepared else ()
        starts = {case.sha256: case.windows.start for case in cases}
        none = np.empty(0, dtype=np.int64)
        return self.evidence.motion_only([starts.get(d.recording.sha256, none)
                                          for d in self.evidence.drives])

    def errors(self, p: Vehicle) -> FloatArray | None:
        """Compute the errors as ``evaluate.errors``; None without motion capture."""
        return None if self.prepared is None else _cached_errors(self, p)

    def horizons(self, p: Vehicle | None, residuals: Residuals | None = None) -> dict[str, Any]:
        """Compute errors as ``evaluate`` gives them, of a model or (None) of constant velocity.

        Without motion capture they follow from the residuals of the sensors; None for channels
        that no sensor measures.
        """
        if self.prepared is not None:
            cases = self.prepared.cases
            found = (errors(predict_ctrv(cases), measured(cases)) if p is None
                     else _cached_errors(self, p))
            return score(found, cases).to_json()
        return {f"{h:.1f}": {"pooled": self._sensor_errors(h, residuals)} for h in HORIZONS}

    def _sensor_errors(self, horizon: float, residuals: Residuals | None) -> dict[str, Any]:
        out: dict[str, Any] = dict.fromkeys(CHANNELS)
        out["n"] = 0
        if residuals is None:
            return out
        for name, column in self.evidence.columns_at(horizon).items():
            error = residuals.motion[:, column]
            out[name] = float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else None
            out["n"] = len(error)
        return out


@lru_cache(maxsize=4)
def _cached_errors(side: RecordingSet, p: Vehicle) -> FloatArray:
    """Compute errors of a model.

    They are cached, because the model with one cause is the reference for the next cause.
    """
    return compute_case_errors(p, side.prepared.cases if side.prepared else (), side.evidence.l_r)


def compute_case_errors(p: Vehicle, cases: Sequence[Case], l_r: float,
                        offsets: Sequence[int] = HORIZON_OFFSETS) -> FloatArray:
    """Compute the errors of a vehicle in recordings, as ``evaluate.errors``.

    l_r: from the centre of mass to the rear axle [m], by which the recordings were read. offsets:
    samples after each start.
    """
    difference = compute_case_differences(p, cases, l_r, offsets)
    return errors(difference, np.zeros_like(difference))


def compute_case_differences(p: Vehicle, cases: Sequence[Case], l_r: float,
                             offsets: Sequence[int] = HORIZON_OFFSETS) -> FloatArray:
    """Compute predicted minus measured states at all horizons, (horizons, 6, windows).

    l_r, offsets: as in ``compute_case_errors``.
    """
    cases = correct_poses(p, cases, l_r)
    return predict(apply_parameter_effects(p), cases, offsets=offsets) - measured(cases, offsets)


def make_recording_set(evidence: Evidence, recordings: Sequence[Recording], l_r: float,
                       reference: Reference | None) -> RecordingSet:
    """Make a set from evidence, with the cases of an evaluation if there are any."""
    try:
        return RecordingSet(evidence, prepare(recordings, l_r=l_r, reference=reference))
    except RecordingError:
        return RecordingSet(evidence, None)


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fit for predictions from logs.

    logged: its vehicle with delays counted from the logs of train and test; timings: of their
    windows and messages; refitted: the delays are fitted, so the commands have no separate age.
    """

    vehicle: Vehicle
    logged: tuple[Vehicle, Vehicle]
    timings: tuple[MessageTiming, MessageTiming]
    refitted: bool

    @property
    def commands(self) -> str:
        """Which commands a prediction uses, in words."""
        return LOGGED_COMMANDS if self.refitted else AGED_COMMANDS


def measure_gain(effect: Effect, reference: Fitted, changed: Fitted, train: RecordingSet,
                 test: RecordingSet, seed: int) -> ErrorReduction:
    """Measure the error reduction of an effect in the channel where it is largest in training."""
    changes_motion = effect.stage != "measurement" or "pose" in effect.signals
    # The channel is chosen by the training recordings, the reported reduction is that of the test
    # recordings: a choice by the test would make it too large.
    if changes_motion and train.prepared and test.prepared:
        channels = rollout_gains(reference.logged, changed.logged, train, test, seed,
                                 changed.commands)
        return max(channels.values(), key=lambda g: g.train)
    found = {}
    for name, column in _columns(effect, train.evidence).items():
        found[name] = _residual_gain(name, column, reference, changed, train, test, seed)
    return max(found.values(), key=lambda g: g.train if math.isfinite(g.train) else -math.inf)


def rollout_gains(reference: tuple[Vehicle, Vehicle], changed: tuple[Vehicle, Vehicle],
                  train: RecordingSet, test: RecordingSet, seed: int, commands: str
                  ) -> dict[str, ErrorReduction]:
    """Return the gain by channel at 1 s; empty without motion capture.

    reference, changed: vehicles for training and test recordings. commands: in words.
    """
    if train.prepared is None or test.prepared is None:
        return {}
    pairs = [(part.errors(p), part.errors(q))
             for part, p, q in zip((train, test), reference, changed, strict=True)]
    block = label_blocks(test.prepared.cases)[0]
    out = {}
    for i, name in enumerate(CHANNELS):
        (a, b), (c, d) = ((x[HORIZON_INDEX, i], y[HORIZON_INDEX, i])  # type: ignore[index]
                          for x, y in pairs)
        interval = gain(c, d, block, seed=seed)
        out[name] = ErrorReduction(name, _relative_reduction(a, b), interval.value, interval.low,
                                   interval.high, ROLLOUT_MEASURE + commands)
    return out


def measure_overall_gain(reference: Fitted, changed: Fitted, train: RecordingSet,
                         test: RecordingSet, seed: int) -> dict[str, ErrorReduction]:
    """Measure the gain by channel 1 s ahead; without motion capture in encoder and gyro."""
    if train.prepared and test.prepared:
        return rollout_gains(reference.logged, changed.logged, train, test, seed, changed.commands)
    return {name: _residual_gain(name, column, reference, changed, train, test, seed)
            for name, column in test.evidence.columns_at(1.0).items()}


def _residual_gain(name: str, column: int, reference: Fitted, changed: Fitted, train: RecordingSet,
                   test: RecordingSet, seed: int) -> ErrorReduction:
    """Measure the gain in one column of the residuals."""
    pairs = []
    for i, part in enumerate((train, test)):
        a, b = (_pick(part.evidence.residuals(p.vehicle, p.timings[i]), column)
                for p in (reference, changed))
        good = np.isfinite(a) & np.isfinite(b)
        labels = part.evidence.blocks(GAIN_BLOCK_S)[0 if column >= 0 else 1]
        pairs.append((a[good], b[good], labels[good]))
    interval = gain(*pairs[1], seed=seed)
    what = "motion 1 s ahead" if column >= 0 else "reading"
    rest = REST_NOTE if name.startswith("accel") else ""
    return ErrorReduction(name, _relative_reduction(*pairs[0][:2]), interval.value, interval.low,
                          interval.high, f"{name}: predicted {what} against the measured one{rest}")


def _columns(effect: Effect, evidence: Evidence) -> dict[str, int]:
    """Return the channels of an effect: the sensors that it changes, else all."""
    columns = evidence.columns
    sensors = {s: columns[s] for channel in effect.signals
               for s in SIGNAL_CHANNELS.get(channel, ()) if s in columns}
    return sensors or dict(columns)


def _pick(r: Residuals, column: int) -> FloatArray:
    return np.asarray(r.motion[:, column] if column >= 0 else r.sensors[:, column])


def _relative_reduction(reference: FloatArray, changed: FloatArray) -> float:
    """Return 1 - RMSE changed / RMSE reference; NaN without readings."""
    if not len(reference):
        return math.nan
    ratio = np.mean(np.square(changed)) / max(np.mean(np.square(reference)), 1e-300)
    return 1.0 - float(np.sqrt(ratio))
