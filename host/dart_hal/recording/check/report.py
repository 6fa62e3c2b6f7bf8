"""Result of a check: one ``RecordingCheck`` per recording, one ``CheckSummary`` over all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.recording.dart import Reference, with_marker_frames
from dart_hal.recording.dart.marker import marker_grid
from dart_hal.recording.dart.model import Recording
from dart_hal.recording.dart.one_car import describe_difference, find_car_difference

from .facts import Range, RecordingFacts, facts, named_time
from .findings import Finding, findings
from .motion import RecordedMotion, motion
from .uses import PURPOSES, Use, uses

# Relative difference above which two quanta have different encoder constants.
QUANTUM_TOLERANCE = 0.05
# Files whose stamps and names differ by the same offset within this time [s] have the same clock.
SAME_CLOCK = 60.0


@dataclass(frozen=True, slots=True)
class RecordingCheck:
    """One recording: what is in it, what is wrong with it, what it is good for."""

    motion: RecordedMotion
    facts: RecordingFacts
    findings: tuple[Finding, ...]
    uses: dict[str, Use]

    @property
    def recording(self) -> Recording:
        """The recording itself."""
        return self.motion.recording

    @property
    def name(self) -> str:
        """Folder and file name; the folder that says what was driven."""
        return f"{folder_of(self.recording.path)}/{self.recording.path.name}"

    @property
    def good_for(self) -> tuple[str, ...]:
        """Purposes that it can contribute to."""
        return tuple(p for p in PURPOSES if self.uses[p].good)

    @property
    def verdict(self) -> str:
        """One line."""
        if not self.good_for:
            serious = [f.text for f in self.findings if f.serious]
            return "good for nothing" + (f": {serious[0]}" if serious else "")
        n = self.uses["evaluation"].n
        parts = [f"evaluation ({n} windows)" if p == "evaluation" else p for p in self.good_for]
        return "good for " + ", ".join(parts)

    def to_json(self) -> dict[str, Any]:
        """Return the object under "files" of ``data check --json``."""
        r = self.recording
        f = self.facts
        m = self.facts.mocap
        return {
            "path": str(r.path), "name": self.name, "schema": r.schema, "sha256": r.sha256,
            "date": f.date, "date_from": f.date_from, "duration_s": f.duration, "rows": f.rows,
            "messages": f.messages, "message_step_s": f.step, "throttle": _pair(f.throttle),
            "steering": _pair(f.steering), "speed_mps": _pair(f.speed),
            "yaw_rate_radps": _pair(f.yaw_rate),
            "encoder": {"state": r.encoder, "quantum_mps": r.quantum, "marks": f.marks,
                        "rounded": f.rounded},
            "mocap": None if m is None else {
                "rows": m.rows, "step_s": m.step, "gaps": m.gaps, "longest_gap_s": m.longest_gap,
                "outliers": m.outliers, "false_lock_share": m.false_lock, "bad_share": m.bad,
                "yaw_wraps": m.wraps, "v_x_mps": _pair(m.v_x),
                "yaw_rate_radps": _pair(m.yaw_rate)},
            "reference": _reference(self.motion.reference),
            "reference_fitted": _reference(self.motion.fitted),
            "findings": [{"kind": x.kind, "effect": x.effect, "rows": x.rows,
                          "serious": x.serious, "text": x.text} for x in self.findings],
            "uses": {p: {"good": u.good, "n": u.n, "unit": u.unit, "why": u.why}
                     for p, u in self.uses.items()},
            "good_for": list(self.good_for), "verdict": self.verdict}


@dataclass(frozen=True, slots=True)
class CheckSummary:
    """Summary of all recordings; notes: on differences that matter if they are pooled."""

    files: int
    schemas: dict[str, int]
    duration: float
    windows: int
    good_for: dict[str, int]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the object under "summary" of ``data check --json``."""
        return {"files": self.files, "schemas": self.schemas, "duration_s": self.duration,
                "windows": self.windows, "good_for": self.good_for, "notes": list(self.notes)}


def folder_of(path: Path) -> str:
    """Return the name of the folder of a recording, which describes the drive."""
    folder = path.absolute().parent
    return folder.parent.name if folder.name == "csv" else folder.name


def stem_of(path: Path) -> str:
    """Return the name of a file without the parts that all files share."""
    return path.name.split(".csv")[0].removesuffix(".mcap").removeprefix("car_1_Datarecording_")


def check(recording: Recording) -> RecordingCheck:
    """Check one recording."""
    m = motion(with_marker_frames([recording])[0])
    lock = 0.0
    if recording.schema == "B" and m.grid is not None:
        lock = float(marker_grid(recording).false_lock.mean())
    f = facts(m, lock)
    return RecordingCheck(m, f, tuple(findings(m, f)), uses(m, f))


def summary(checks: Sequence[RecordingCheck]) -> CheckSummary:
    """Summarise checks: counts, and what their differences mean for pooling."""
    return CheckSummary(
        files=len(checks),
        schemas=dict(sorted(Counter(c.recording.schema for c in checks).items())),
        duration=float(sum(c.facts.duration for c in checks)),
        windows=sum(c.uses["evaluation"].n for c in checks),
        good_for={p: sum(p in c.good_for for c in checks) for p in PURPOSES},
        notes=tuple(_note_differences(checks)))


def _note_differences(checks: Sequence[RecordingCheck]) -> list[str]:
    """Return notes on cars, encoder constants, order and copies of several recordings."""
    notes = []
    difference = find_car_difference([c.recording for c in checks])
    if difference is not None:
        notes.append("recordings of two cars, or of one that was changed in between: "
                     f"{describe_difference(difference)}; fit each group by itself")
    quanta = sorted(c.recording.quantum for c in checks if c.recording.quantum)
    groups = [q for i, q in enumerate(quanta)
              if i == 0 or q > quanta[i - 1] * (1.0 + QUANTUM_TOLERANCE)]
    if len(groups) > 1:
        notes.append("encoder constants of different days ("
                     + ", ".join(f"{q:.4f}" for q in groups)
                     + " m/s per count): never pool the quantisation")
    notes += _note_order(checks)
    same = Counter(c.recording.sha256 for c in checks)
    twice = sum(n - 1 for n in same.values())
    if twice:
        notes.append(f"{twice} file(s) are copies of another one: they count twice in a fit")
    return notes


def _note_order(checks: Sequence[RecordingCheck]) -> list[str]:
    """Report files whose name and sensor clock give different orders.

    The sensor node counts from its start, so files of one start share the offset between that
    count and the time in the name. A file whose offset few others share has a wrong name.
    """
    notes = []
    for folder in dict.fromkeys(c.recording.path.parent for c in checks):
        named = [(c, day.timestamp()) for c in checks if c.recording.path.parent == folder
                 and c.recording.schema in ("A", "B") and (day := named_time(c.recording.path))]
        start = np.array([c.recording.messages.t[0] for c, _ in named])
        offset = start - np.array([stamp for _, stamp in named])
        for i, (c, stamp) in enumerate(named):
            agree = np.abs(offset - offset[i]) < SAME_CLOCK
            for k, (other, later) in enumerate(named):
                if (later > stamp and start[k] < start[i] and not agree[k]
                        and int((np.abs(offset - offset[k]) < SAME_CLOCK).sum()) > agree.sum()):
                    notes.append(f"{c.name} was recorded after "
                                 f"{other.recording.path.name} by the sensor clock, "
                                 "in spite of its name")
                    break
    return notes


def _pair(values: Range | None) -> list[float] | None:
    return None if values is None else [values[0], values[1]]


def _reference(r: Reference | None) -> dict[str, Any] | None:
    if r is None:
        return None
    return {"lx_m": r.lx, "theta_rad": r.theta, "ly_m": r.ly, "source": r.source,
            "std": r.to_json()["std"]}
