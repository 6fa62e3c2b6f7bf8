"""Rows of the paper's folders, joined as its scripts join them.

The files of a folder in name order, with one mean time step between them, throttle zero while the
gate is closed. Differentiation across the joins causes false accelerations (about four per
folder). The published values contain them; no other module joins files.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording.dart.schema import MOCAP_COLUMNS, SENSOR_COLUMNS, SENSOR_TIME
from dart_hal.recording.dart.table import parse
from dart_lab.identification.report import FileReport

# Folder of each sub-model.
FOLDERS = {"friction": "19_step_input_data", "motor": "29_step_input_data",
           "steering": "30_step_steering_data", "delay": "40_sinusoidal_steering_data",
           "tyres": "50_tire_model_data"}
MIN_FOLDER_ROWS = 50
# [m/s] A car whose encoder never exceeds it did not drive.
MIN_DRIVEN_SPEED = 0.05


@dataclass(frozen=True, slots=True)
class JoinedRows:
    """n joined rows: t [s] continuous, columns (n,) by their names in the files.

    throttle: behind the gate. spans: (first, end) row of each file.
    """

    t: FloatArray
    columns: Mapping[str, FloatArray]
    throttle: FloatArray
    spans: Mapping[str, tuple[int, int]]
    sha256: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def speed(self) -> FloatArray:
        """Encoder [m/s]."""
        return self.columns["vel encoder"]

    @property
    def yaw_rate(self) -> FloatArray:
        """Gyro [rad/s]."""
        return self.columns["W (IMU)"]

    @property
    def steering(self) -> FloatArray:
        """Command, -1..1."""
        return self.columns["steering"]

    def reports(self, used: BoolArray, why: str) -> dict[str, FileReport]:
        """Report the rows of each file in the mask ``used`` (n,), and ``why`` others are not."""
        out = {}
        for file, (first, end) in self.spans.items():
            count = int(used[first:end].sum())
            dropped = end - first - count
            out[file] = FileReport(count, dropped, (why,) if dropped else (),
                                   self.sha256.get(file, ""))
        return out


def make_too_few_error(submodel: str, needs: str, found: int) -> RecordingError:
    """Make the error for fewer than MIN_FOLDER_ROWS rows that count; needs: which, in words."""
    return RecordingError(f"too few rows for {submodel}: it needs {needs}",
                          found=f"{found} such row(s)", expected=f"at least {MIN_FOLDER_ROWS}",
                          remedy="give recordings of the test that the paper made for it")


def read_folder(root: str | Path, folder: str, schema: str = "A") -> JoinedRows:
    """Read and join all files of ``root/folder``; schema "A", or "B" with mocap.

    Raises RecordingError for a folder that is missing, empty or of mixed schemas, for a file
    whose time does not increase, for too few rows, and for a car that never moves.
    """
    place = Path(root) / folder
    files = sorted([*place.glob("*.csv"), *place.glob("*.csv.gz")])
    if not files:
        raise RecordingError(f"{place}: no recording", read=str(place),
                             found="no such folder" if not place.is_dir() else "no *.csv file",
                             expected=f"{', '.join(FOLDERS.values())} inside {root}",
                             remedy="--as-paper ROOT, the folder that holds these folders")
    needed = SENSOR_COLUMNS if schema == "A" else (*SENSOR_COLUMNS, *MOCAP_COLUMNS)
    tables = [_table(file, schema, needed) for file in files]
    rows = _join(files, tables)
    if len(rows) < MIN_FOLDER_ROWS:
        raise RecordingError(f"{place}: too few rows for a fit", found=f"{len(rows)} rows",
                             expected=f"at least {MIN_FOLDER_ROWS}", read=str(place),
                             remedy="leave this folder out")
    if not np.any(rows.speed > MIN_DRIVEN_SPEED):
        raise RecordingError(f"{place}: the car never moves, or its encoder is dead",
                             found=f"at most {rows.speed.max():.3f} m/s", read=str(place),
                             expected=f"speeds above {MIN_DRIVEN_SPEED} m/s",
                             remedy="leave this folder out, or without --as-paper use the mocap")
    return rows


def _table(file: Path, schema: str, needed: Sequence[str]) -> dict[str, FloatArray]:
    found, columns, _ = parse(file)
    if found != schema:
        raise RecordingError(f"{file}: schema {found} among files of schema {schema}",
                             found=f"schema {found}", expected=f"schema {schema}", read=str(file),
                             likely="a recording of another test in the same folder",
                             remedy="move this file elsewhere, or identify without --as-paper")
    used = {name: columns[name] for name in needed}
    bad = ~np.all([np.isfinite(v) for v in used.values()], axis=0)
    if bad.any():
        raise RecordingError(f"{file}: line {int(np.argmax(bad)) + 2} holds no finite number",
                             found=f"{int(bad.sum())} such line(s)", read=str(file),
                             expected="numbers in every cell", remedy="repair or delete the line")
    if schema == "B":
        started = used[SENSOR_TIME] != 0.0
        used = {name: v[started] for name, v in used.items()}
    time = used[SENSOR_TIME if schema == "A" else "vicon time"]
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if len(time) < 2 or len(back):
        raise RecordingError(
            f"{file}: time does not advance" + (f" after row {back[0] + 1}" if len(back) else ""),
            found=f"{len(time)} row(s), {len(back)} step(s) back or of zero", read=str(file),
            expected="advancing stamps, as the paper's splines need them",
            remedy="leave this file out, or identify without --as-paper, which cuts there")
    return used


def _join(files: Sequence[Path], tables: Sequence[Mapping[str, FloatArray]]) -> JoinedRows:
    clock = "vicon time" if "vicon time" in tables[0] else SENSOR_TIME
    parts: list[FloatArray] = []
    spans = {}
    first = 0
    for file, table in zip(files, tables, strict=True):
        t = table[clock] - table[clock][0]
        if parts:
            t = t + parts[-1][-1] + float(np.mean(np.diff(t)))
        parts.append(t)
        spans[str(file)] = (first, first + len(t))
        first += len(t)
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    throttle = np.where(columns["safety_value"] == 1.0, columns["throttle"], 0.0)
    digests = {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    return JoinedRows(np.concatenate(parts), columns, throttle, spans, digests)
