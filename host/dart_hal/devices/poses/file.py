"""Poses from a CSV file, played back in the car's time: header ``t,x,y,yaw``."""

from __future__ import annotations

import csv
from collections import deque
from collections.abc import Iterable
from pathlib import Path

from dart_hal.core.errors import RecordingError
from dart_hal.core.text_file import read_text
from dart_hal.core.types import ExternalPose
from dart_hal.devices.poses.reading import Convention, PoseReading

REQUIRED_COLUMNS = ("t", "x", "y", "yaw")
OPTIONAL_COLUMNS = ("std", "yaw_std")


class FileSource:
    """Source of poses: the first row arrives at the first poll, the others by their stamps."""

    on_board = False
    map_std = 0.0

    def __init__(self, path: Path, readings: Iterable[PoseReading]) -> None:
        self.name = f"file://{path}"
        self._rows = deque(readings)
        self._first = self._rows[0].t
        self._start: float | None = None

    def poll(self, now: float) -> list[ExternalPose]:
        """Return the rows that are due, as ``PoseSource``."""
        if self._start is None:
            self._start = now
        due = []
        while self._rows and (t := self._start + self._rows[0].t - self._first) <= now:
            due.append(self._rows.popleft().to_external(t))
        return due

    def close(self) -> None:
        self._rows.clear()


def open_file(path: Path, convention: Convention) -> FileSource:
    """Open a CSV file as a source of poses. Raises RecordingError with file and line."""
    if path.exists() and not path.is_file():  # a FIFO would block for ever
        raise RecordingError(f"{path}: is no file", read=str(path), found="a folder or a device",
                             expected="a CSV file", remedy="file://poses.csv")
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as why:
        raise RecordingError(f"{path}: cannot be read as CSV", found=str(why), read=str(path),
                             remedy="a text file with the header t,x,y,yaw") from why
    table = csv.DictReader(lines, skipinitialspace=True)
    header = tuple(table.fieldnames or ())
    if (not set(REQUIRED_COLUMNS) <= set(header)
            or not set(header) <= {*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS}):
        raise RecordingError(f"{path}: not the columns of poses", read=str(path),
                             found=",".join(header)[:80] or "an empty file",
                             expected="t,x,y,yaw and, if known, std,yaw_std",
                             remedy="s, m, rad; other units by ?units=mm&angle=deg")
    readings: list[PoseReading] = []
    for row in _rows(table, path):
        try:
            reading = convention.read(PoseReading("", "file", **{
                name: float(row[name]) for name in header}))
            reading.to_external(0.0)
            if readings and reading.t <= readings[-1].t:
                raise ValueError(f"t = {reading.t:g} s after {readings[-1].t:g} s")
        except (ValueError, TypeError, OverflowError) as why:
            raise RecordingError(f"{path}: line {table.line_num} is no pose", found=str(why),
                                 read=str(path), expected="finite numbers, t that advances",
                                 remedy="leave the line out") from why
        readings.append(reading)
    if not readings:
        raise RecordingError(f"{path}: contains no pose", read=str(path), found="only a header",
                             expected="a row for each pose", remedy="give another file")
    return FileSource(path, readings)


def _rows(table: csv.DictReader[str], path: Path) -> list[dict[str, str]]:
    """Return all rows. Raises RecordingError for a cell that is longer than csv allows."""
    try:
        return list(table)
    except csv.Error as why:
        raise RecordingError(f"{path}: line {table.line_num} cannot be read as CSV",
                             found=str(why), read=str(path), expected="numbers",
                             remedy="leave the line out") from why
