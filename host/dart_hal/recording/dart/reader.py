"""Read files and folders as Recordings; each correction is a note."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray
from dart_hal.recording.fetch.published import published_content

from .marker import marker_grid
from .mocap import mocap as read_mocap
from .model import Mocap, Note, Recording, freeze
from .quantum import encoder_quantum
from .ranges import check_units, check_values
from .schema import DERIVED_C, NEVER_MEASURED, USED
from .sensors import check_commands, commands_only, messages, not_started
from .steering_sign import steering_note
from .stuck import drop_stuck_sensors
from .table import decode_content, keep_finite, parse_text, read_content

# Speed of the mocap [m/s], of a car of 1:10, for a second at which the encoder must count.
MIN_MOCAP_SPEED = 0.15
MIN_MOCAP_ROWS = 30


def read(path: str | Path) -> Recording:
    """Read one DART recording of schema A, B or C.

    Errors: RecordingError with the file, what was found, what was expected.
    """
    path = Path(path)
    file = str(path)
    content = read_content(path)
    schema, columns, dropped = parse_text(decode_content(content, file), file)
    rows = len(next(iter(columns.values()))) + sum(n for _, n in dropped)
    notes = [Note(why, n, "cut_off_line") for why, n in dropped]
    notes += _never_measured(columns)
    if any(c in columns for c in DERIVED_C):
        notes.append(Note("derived columns of schema C not used: plain differences of the pose, "
                          "in spite of their names", kind="derived"))
    columns, bad = keep_finite(columns, USED[schema], file)
    if bad:
        notes.append(Note("rows with an empty or non-finite cell", bad, "not_finite"))
    notes += _signed_zeros(columns)
    check_commands(columns, file)
    check_values(columns, file)
    if schema != "C":
        idle = not_started(columns, schema)
        if idle.all():
            raise RecordingError(f"{file}: no sensor message in this recording", read=file,
                                 found=f"{len(idle)} rows with elapsed time 0",
                                 expected="rows with sensor data", remedy="leave this file out")
        if idle.any():
            notes.append(Note("rows before the first sensor message", int(idle.sum()),
                              "not_started"))
        columns = {c: v[~idle] for c, v in columns.items()}
    check_units(columns, file)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    recording = _assemble(path, schema, columns, notes, digest)
    return replace(recording, rows=rows, notes=(*recording.notes, *steering_note(recording)),
                   published=hashlib.sha256(content).hexdigest() in published_content())


def _assemble(path: Path, schema: str, columns: dict[str, FloatArray], notes: list[Note],
              digest: str) -> Recording:
    pose: Mocap | None = None
    # Rows without a pose are dropped first: sensors and poses of schemas B and C share their rows.
    if schema != "A":
        pose, keep, more = read_mocap(columns)
        notes += more
        columns = {c: v[keep] for c, v in columns.items()}
        if len(pose) < MIN_MOCAP_ROWS:
            raise RecordingError(f"{path}: too few mocap rows", found=f"{len(pose)} rows",
                                 expected=f"at least {MIN_MOCAP_ROWS}", read=str(path),
                                 remedy="leave this file out")
    if schema == "C" and pose is not None:
        sensors, more = commands_only(columns, pose.t)
    else:
        sensors, more = messages(columns, None if pose is None else pose.t)
    recording = Recording(path, schema, sensors, pose, "none" if schema == "C" else "ok", None,
                          digest, ())
    recording = drop_stuck_sensors(replace(recording, notes=tuple(notes + more)))
    return _judge_encoder(note_false_lock(recording))


def _never_measured(columns: dict[str, FloatArray]) -> list[Note]:
    present = [c for c in NEVER_MEASURED if c in columns]
    if not present:
        return []
    # Columns that older recorders wrote without a sensor behind them.
    zero = all(bool(np.all(np.nan_to_num(columns[c]) == 0.0)) for c in present)
    return [Note(f"columns {' and '.join(present)} are zero in every row: never measured, dropped"
                 if zero else f"columns {' and '.join(present)} not used", kind="not_measured")]


def _signed_zeros(columns: dict[str, FloatArray]) -> list[Note]:
    rows = int(np.any([np.signbit(v) & (v == 0.0) for v in columns.values()], axis=0).sum())
    return [Note("negative zeros read as zeros", rows, "negative_zero")] if rows else []


def note_false_lock(recording: Recording) -> Recording:
    """Return a recording with mocap and encoder, with a note if the mocap locked falsely."""
    if recording.mocap is None or recording.schema == "C" or recording.encoder == "dead":
        return recording
    lock = marker_grid(recording).false_lock
    if not lock.any():
        return recording
    note = Note(f"false lock of the mocap (pose at rest, encoder turns): "
                f"{lock.sum() / 100.0:.2f} s, {lock.mean():.0%} of the recording",
                kind="false_lock")
    return replace(recording, notes=(*recording.notes, note))


def _judge_encoder(recording: Recording) -> Recording:
    """Infer the quantum of the encoder; if it is always 0, decide between dead and at rest."""
    if recording.schema == "C" or recording.encoder == "dead":
        return recording
    speed = recording.messages.speed
    # 1. An encoder that counts: its speeds are multiples of one quantum. 2. Always 0 while the
    #    poses move: dead. 3. Always 0 otherwise: the car was at rest.
    if np.any(speed != 0.0):
        quantum = encoder_quantum(speed)
        note = (f"encoder quantum {quantum:.5f} m/s per count" if quantum
                else "encoder quantum cannot be inferred from these speeds")
        return replace(recording, quantum=quantum,
                       notes=(*recording.notes, Note(note, kind="quantum")))
    if _mocap_moves(recording):
        nan = freeze(np.full(len(speed), np.nan))
        note = "encoder dead: always 0 while the mocap shows the car driving"
        return replace(recording, encoder="dead",
                       notes=(*recording.notes, Note(note, kind="encoder_dead")),
                       messages=replace(recording.messages, speed=nan))
    note = "encoder always 0 and nothing shows that the car moved: taken as standstill"
    return replace(recording, encoder="zero",
                   notes=(*recording.notes, Note(note, kind="encoder_zero")))


def _mocap_moves(recording: Recording) -> bool:
    if recording.mocap is None:
        return False
    m = marker_grid(recording)
    speed = np.hypot(m.dx, m.dy) / recording.scale.speed
    return int(((speed > MIN_MOCAP_SPEED) & ~m.bad).sum()) > 100


def read_all(paths: Iterable[str | Path]
             ) -> tuple[list[Recording], list[tuple[str, str]]]:
    """Return recordings and skipped (file, reason) of files and folders, in name order.

    In a folder, a file that cannot be used is skipped; a file that is named by itself is refused.
    Errors: RecordingError, also for a folder without any usable file.
    """
    recordings: list[Recording] = []
    skipped: list[tuple[str, str]] = []
    read_paths: set[Path] = set()
    for entry in map(Path, paths):
        if not entry.is_dir():
            if entry.resolve() not in read_paths:
                recordings.append(read(entry))
            read_paths.add(entry.resolve())
            continue
        found = 0
        for file in sorted([*entry.rglob("*.csv"), *entry.rglob("*.csv.gz")]):
            if file.resolve() in read_paths:
                found += 1
                continue
            read_paths.add(file.resolve())
            try:
                recordings.append(read(file))
                found += 1
            except RecordingError as err:
                skipped.append((str(file), err.what.removeprefix(f"{file}: ")))
        if not found:
            raise RecordingError(f"{entry}: no usable recording in this folder", read=str(entry),
                                 found=f"{len(skipped)} CSV file(s), none usable"
                                 if skipped else "no *.csv file",
                                 expected="CSV files of schema A, B or C",
                                 remedy="check the path; $DART_DATA is the folder of recordings")
    return recordings, skipped
