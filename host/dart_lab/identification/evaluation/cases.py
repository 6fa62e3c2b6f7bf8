"""Preparation of recordings for open-loop prediction, with a report on every file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dart_hal.core.errors import RecordingError
from dart_hal.recording.check import folder_of
from dart_hal.recording.dart import (
    RUN,
    Grid,
    Recording,
    Reference,
    grid,
    with_marker_frames,
)
from dart_hal.recording.dart.grid import L_R, UNKNOWN_FRAME
from dart_hal.recording.dart.reference import NEEDED, OPTION
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.drive import remove_mocap_effects
from dart_lab.identification.prediction.windows import (
    Windows,
    find_windows,
    is_covered,
    least_speed,
)

EXCLUDED = "window(s) left out"
NO_MOCAP = "no motion capture"
NO_POSES = "a run without poses from outside"
FRAME_NOTES = ("steering_reversed", "marker", "marker_differs", "marker_of_day")
DATA_NOTES = ("false_lock", "outliers", "mocap_gap", "encoder_dead")
OWN_REMEDY = ("record with $DART_HAL_POSES=udp://:5005; in the simulator: sim://?mocap=1 "
              "(docs/how_to/poses.md); dart-hal identify all RUNS needs none")


@dataclass(frozen=True, slots=True)
class Case:
    """One recording with at least one window; file: its key in every table and JSON.

    sha256: of the file's bytes, "" if there is no file.
    """

    file: str
    grid: Grid
    windows: Windows
    sha256: str = ""

    def __len__(self) -> int:
        return len(self.windows)


@dataclass(frozen=True, slots=True)
class FileUse:
    """used, dropped: samples of 10 ms inside and outside of windows; why: sentences."""

    used: int = 0
    windows: int = 0
    dropped: int = 0
    why: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """As ``dart-hal evaluate --json`` prints it."""
        return {"used": self.used, "windows": self.windows, "dropped": self.dropped,
                "why": list(self.why)}


@dataclass(frozen=True, slots=True)
class Prepared:
    """Recordings that can be predicted, and a report on every file."""

    cases: tuple[Case, ...]
    files: Mapping[str, FileUse] = field(default_factory=dict)

    @property
    def windows(self) -> int:
        """Number of windows of all recordings."""
        return sum(len(case) for case in self.cases)


def prepare(recordings: Sequence[Recording], *, l_r: float = L_R,
            reference: Reference | None = None, named: Sequence[Path] = (),
            skipped: Sequence[tuple[str, str]] = ()) -> Prepared:
    """Compute grid and windows of every recording with motion capture.

    l_r [m]: rear axle to centre of mass of the model under test. reference: marker frame of all
    recordings; None: known or fitted, see ``with_marker_frames``. named: files that must be
    usable; the others are listed. skipped: (file, reason) of files that could not be read. Raises
    RecordingError for an unusable file of ``named``, and if no window remains.
    """
    required = {path.resolve() for path in named}
    files = {_key(Path(file)): FileUse(why=(reason,)) for file, reason in skipped}
    cases = []
    for recording in with_marker_frames(recordings, reference):
        key = _key(recording.path)
        key = key if key not in files else str(recording.path)
        try:
            case, use = _make_case(key, recording, reference, l_r)
        except RecordingError as err:
            if recording.path.resolve() in required:
                raise
            case = None
            use = FileUse(why=(err.what.removeprefix(f"{recording.name}: "),))
        files[key] = use
        if case is not None and len(case):
            cases.append(case)
        elif case is not None and recording.path.resolve() in required:
            raise RecordingError(
                f"{recording.name}: no window of 2 s can be used", found="; ".join(use.why),
                expected=f"2.2 s above {least_speed(recording):.2g} m/s with sound motion capture",
                read=str(recording.path), remedy="leave this file out")
    if not cases:
        raise _make_no_case_error(files)
    return Prepared(tuple(cases), files)


def short(file: str, folder: int = 26) -> str:
    """Return folder and file for a label, without the common parts of DART file names."""
    above, _, name = file.rpartition("/")
    name = name.removesuffix(".gz").removesuffix(".csv").replace("car_1_Datarecording_", "")
    above = above.rpartition("/")[2]
    return f"{above[:folder]}/{name[:28]}" if above else name[:40]


def _make_case(key: str, recording: Recording, reference: Reference | None,
               l_r: float) -> tuple[Case, FileUse]:
    if recording.mocap is None:
        own = recording.schema == RUN
        raise RecordingError(
            f"{recording.name}: {NO_POSES if own else NO_MOCAP}, so nothing to compare a "
            "prediction with", found="a run" if own else f"schema {recording.schema}",
            expected="30 poses or more on /external_pose" if own
            else "vicon columns (schema B or C)", read=str(recording.path),
            remedy=OWN_REMEDY if own else "give a recording with vicon columns")
    g = grid(recording, reference, l_r)
    windows = find_windows(g)
    used = int(is_covered(windows, len(g)).sum())
    why = [*(str(note) for note in recording.notes if note.kind in FRAME_NOTES),
           *(f"{count} {EXCLUDED}: {reason}" for count, reason in (
        (windows.slow, f"start at {least_speed(recording):.2g} m/s or slower"),
        (windows.bad, "hold samples that the mocap or the messages got wrong")) if count)]
    if not len(windows) and not why:
        why = [f"{len(g) / 100:.1f} s are too short for a window of 2 s"]
    why += [str(note) for note in recording.notes if note.kind in DATA_NOTES]
    return (Case(key, g, windows, recording.sha256),
            FileUse(used, len(windows), len(g) - used, tuple(why)))


def _key(path: Path) -> str:
    return f"{folder_of(path)}/{path.name}"


def _make_no_case_error(files: Mapping[str, FileUse]) -> RecordingError:
    reasons = [why for use in files.values() for why in use.why[:1]]
    common = max(reasons, key=reasons.count) if reasons else "no file"
    if reasons and all(NO_POSES in why for why in reasons):
        return RecordingError(
            "runs without poses from outside cannot be evaluated",
            found=f"{len(files)} run(s)", expected="recordings with motion capture",
            read=", ".join(list(files)[:3]), remedy=OWN_REMEDY)
    if UNKNOWN_FRAME in common:
        return RecordingError(
            "no recording can be used for open-loop prediction: the marker frame is not known",
            found=f"{len(files)} file(s) whose driving does not identify it", expected=NEEDED,
            read=", ".join(list(files)[:3]), remedy=OPTION)
    return RecordingError(
        "no recording can be used for open-loop prediction",
        found=f"{len(files)} file(s), most of them: {common}",
        expected="recordings with motion capture in which the car drives faster than 0.3 m/s",
        read=", ".join(list(files)[:3]),
        remedy="give DART CSV files of schema B or C: they have vicon columns"
        if NO_MOCAP in common else
        "give longer or faster drives: a window is 2 s and starts above 0.3 m/s; "
        "dart-hal data check says how many a file has")


def correct_poses(p: Vehicle, cases: Sequence[Case], l_r: float) -> Sequence[Case]:
    """Remove the effects of the vehicle on the poses of recordings.

    l_r: from the centre of mass to the rear axle [m], by which the recordings were read.
    """
    if not signals(p, "pose"):
        return cases
    return [replace(case, grid=remove_mocap_effects(case.grid, p, l_r)) for case in cases]
