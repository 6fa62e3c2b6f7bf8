"""What a model predicts on recordings, and what one model gains over another there.

    gain = 1 - RMSE(after) / RMSE(before)

by channel, on recordings that no fit has seen. Its 95 % interval is a bootstrap over blocks of
time (or whole recordings), in which both models keep the same windows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.compose import settled, signals
from dart_hal.vehicle.effect import Effect
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.cases import Case, Prepared, prepare
from dart_lab.identification.evaluation.compare import blocks, gain
from dart_lab.identification.evaluation.prediction import CHANNELS, errors, hold, measured, predict
from dart_lab.identification.evaluation.scores import score
from dart_lab.identification.prediction.windows import HORIZONS

from .evidence.drive import remove_mocap_effects
from .evidence.residuals import SIGNAL_CHANNELS, Evidence, Residuals
from .evidence.space import MessageTiming
from .result import Gained

AT = HORIZONS.index(1.0)
QUIET = ", one of a standing car counted by how much less it shakes"
ROLLOUT = "open-loop prediction over 1 s from the measured state, "
LOGGED, AGED = "logged commands alone", "logged commands at the age that suits the log"


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """Recordings of one side, train or test: evidence, and cases where mocap saw them."""

    evidence: Evidence
    prepared: Prepared | None

    @property
    def names(self) -> list[str]:
        """Of its drives that have anything to judge, as the rows of the evidence number them;
        stretches of one recording are counted."""
        used = np.union1d(self.evidence.motion_drive, self.evidence.sensor_drive)
        plain = [self.evidence.drives[i].recording.name for i in used.tolist()]
        return [name if plain.count(name) == 1 else f"{name} ({plain[:i].count(name) + 1})"
                for i, name in enumerate(plain)]

    def evaluation_windows(self) -> Evidence:
        """Evidence of the motion alone, in the windows of the evaluation.

        None of them without motion capture.
        """
        cases = self.prepared.cases if self.prepared else ()
        starts = {case.sha256: case.windows.start for case in cases}
        none = np.empty(0, dtype=np.int64)
        return self.evidence.motion_only([starts.get(d.recording.sha256, none)
                                           for d in self.evidence.drives])

    def errors(self, p: Vehicle) -> FloatArray | None:
        """As ``evaluate.errors``; None without motion capture."""
        return None if self.prepared is None else _predicted(self, p)

    def horizons(self, p: Vehicle | None, residuals: Residuals | None = None) -> dict[str, Any]:
        """Errors as ``evaluate`` gives them, of a model or (None) of constant velocity.

        Without motion capture what the sensors show of it, from the residuals of
        the model; None where nothing does.
        """
        if self.prepared is not None:
            cases = self.prepared.cases
            found = errors(hold(cases), measured(cases)) if p is None else _predicted(self, p)
            return score(found, cases).to_json()
        return {f"{h:.1f}": {"pooled": self._by_sensors(h, residuals)} for h in HORIZONS}

    def _by_sensors(self, horizon: float, residuals: Residuals | None) -> dict[str, Any]:
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
def _predicted(side: Side, p: Vehicle) -> FloatArray:
    """Kept for a while: what is before one cause is after the one that gains more."""
    return compute_case_errors(p, side.prepared.cases if side.prepared else (), side.evidence.l_r)


def compute_case_errors(p: Vehicle, cases: Sequence[Case], l_r: float) -> FloatArray:
    """Compute the errors of a vehicle in recordings, as ``evaluate.errors``.

    l_r: from the centre of mass to the rear axle [m], by which the recordings were read.
    """
    difference = compute_case_differences(p, cases, l_r)
    return errors(difference, np.zeros_like(difference))


def compute_case_differences(p: Vehicle, cases: Sequence[Case], l_r: float) -> FloatArray:
    """Compute predicted minus measured states at all horizons, (horizons, 6, windows).

    l_r: as in ``compute_case_errors``.
    """
    cases = correct_poses(p, cases, l_r)
    return predict(settled(p), cases) - measured(cases)


def correct_poses(p: Vehicle, cases: Sequence[Case], l_r: float) -> Sequence[Case]:
    """Remove from the poses of recordings what effects of the vehicle do to them.

    l_r: as in ``compute_case_errors``.
    """
    if not signals(p, "pose"):
        return cases
    return [replace(case, grid=remove_mocap_effects(case.grid, p, l_r)) for case in cases]


def side_of(evidence: Evidence, recordings: Sequence[Recording], l_r: float,
            reference: Reference | None) -> Side:
    """Evidence with the windows of the evaluation where there are any."""
    try:
        return Side(evidence, prepare(recordings, l_r=l_r, reference=reference))
    except RecordingError:
        return Side(evidence, None)


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fit as it predicts. logged: its vehicle with delays counted from the logs of train and
    test; timings: of their windows and messages; refitted: the delays are, so that the commands
    have no age of their own."""

    vehicle: Vehicle
    logged: tuple[Vehicle, Vehicle]
    timings: tuple[MessageTiming, MessageTiming]
    refitted: bool

    @property
    def commands(self) -> str:
        """What a prediction knows of the commands."""
        return LOGGED if self.refitted else AGED


def gained(effect: Effect, before: Fitted, after: Fitted, train: Side, test: Side, seed: int,
           block_s: float) -> Gained:
    """What an effect takes away where it shows; the channel is chosen on the training side.

    block_s: of the bootstrap over residuals.
    """
    of_motion = effect.stage != "measurement" or "pose" in effect.signals
    if of_motion and train.prepared and test.prepared:
        channels = _rollout_gains(before.logged, after.logged, train, test, seed, after.commands)
        return max(channels.values(), key=lambda g: g.train)
    found = {}
    for name, column in _columns(effect, train.evidence).items():
        found[name] = _residual_gain(name, column, before, after, train, test, seed, block_s)
    return max(found.values(), key=lambda g: g.train if math.isfinite(g.train) else -math.inf)


def rollout_gains(before: Vehicle, after: Vehicle, train: Side, test: Side,
                  seed: int) -> dict[str, Gained]:
    """By channel at 1 s; empty without motion capture."""
    return _rollout_gains((before, before), (after, after), train, test, seed, LOGGED)


def _rollout_gains(before: tuple[Vehicle, Vehicle], after: tuple[Vehicle, Vehicle], train: Side,
                   test: Side, seed: int, commands: str) -> dict[str, Gained]:
    """The same with vehicles of their own on each side; commands: what is known of them."""
    if train.prepared is None or test.prepared is None:
        return {}
    sides = [(side.errors(p), side.errors(q))
             for side, p, q in zip((train, test), before, after, strict=True)]
    block = _blocks(test.prepared.cases)
    out = {}
    for i, name in enumerate(CHANNELS):
        (a, b), (c, d) = ((x[AT, i], y[AT, i]) for x, y in sides)  # type: ignore[index]
        interval = gain(c, d, block, seed=seed)
        out[name] = Gained(name, _share(a, b), interval.value, interval.low, interval.high,
                           ROLLOUT + commands)
    return out


def overall(before: Fitted, after: Fitted, train: Side, test: Side, seed: int, block_s: float
            ) -> dict[str, Gained]:
    """``rollout_gains``, or what sensors tell of it."""
    if train.prepared and test.prepared:
        return _rollout_gains(before.logged, after.logged, train, test, seed, after.commands)
    return {name: _residual_gain(name, column, before, after, train, test, seed, block_s)
            for name, column in test.evidence.columns_at(1.0).items()}


def _residual_gain(name: str, column: int, before: Fitted, after: Fitted, train: Side, test: Side,
                   seed: int, block_s: float) -> Gained:
    pairs = []
    for i, side in enumerate((train, test)):
        a, b = (_pick(side.evidence.residuals(p.vehicle, p.timings[i]), column)
                for p in (before, after))
        good = np.isfinite(a) & np.isfinite(b)
        labels = side.evidence.blocks(block_s)[0 if column >= 0 else 1]
        pairs.append((a[good], b[good], labels[good]))
    interval = gain(*pairs[1], seed=seed)
    what = "motion 1 s ahead" if column >= 0 else "reading"
    rest = QUIET if name.startswith("accel") else ""
    return Gained(name, _share(*pairs[0][:2]), interval.value, interval.low, interval.high,
                  f"{name}: predicted {what} against the measured one{rest}")


def _columns(effect: Effect, evidence: Evidence) -> dict[str, int]:
    """Where an effect shows: in the sensors that it changes, else anywhere."""
    every = evidence.columns
    sensors = {s: every[s] for channel in effect.signals for s in SIGNAL_CHANNELS.get(channel, ())
               if s in every}
    return sensors or dict(every)


def _pick(r: Residuals, column: int) -> FloatArray:
    return np.asarray(r.motion[:, column] if column >= 0 else r.sensors[:, column])


def _share(before: FloatArray, after: FloatArray) -> float:
    """1 - RMSE after / RMSE before; NaN where nothing was read."""
    if not len(before):
        return math.nan
    return 1.0 - float(np.sqrt(np.mean(np.square(after)) / max(np.mean(np.square(before)), 1e-300)))


def _blocks(cases: Sequence[Case]) -> IntArray:
    return blocks(cases)[0]
