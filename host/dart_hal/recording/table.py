"""Runs as CSV: all columns of a State, or the ten columns of the DART recordings.

``run.csv`` has all of a State in SI units, exactly; ``run.dart.csv`` the columns of the published
DART recordings, for tools that read those.
"""

from __future__ import annotations

import csv
from pathlib import Path
from types import TracebackType
from typing import Any

from dart_hal.core.errors import RecordingError
from dart_hal.core.text_file import read_text
from dart_hal.core.types import State

# s, -, m/s, m/s, rad/s, m/s2, m/s2, edges, m, m, rad, rad, -1..1, us, us, names, names.
CSV_COLUMNS = ("t", "seq", "speed", "speed_std", "yaw_rate", "accel_x", "accel_y", "ticks",
           "x", "y", "yaw", "steering", "throttle", "steering_us", "throttle_us", "limited",
           "flags")

# Schema A of the DART recordings: s, 0, 0, m/s2, m/s2, rad/s, m/s unsigned, 0/1, two commands.
DART_COLUMNS = ("elapsed time sensors", "current", "voltage", "acc x (IMU)", "acc y (IMU)",
                "W (IMU)", "vel encoder", "safety_value", "throttle", "steering")

_TEXT_COLUMNS = ("limited", "flags")
_INTEGER_COLUMNS = ("seq", "ticks")

Row = dict[str, Any]


class _CsvWriter:
    """Common part: the methods of a recorder, of which only ``state`` writes."""

    columns: tuple[str, ...] = ()
    newline = "\n"

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("w", encoding="ascii", newline="")
        self._file.write(",".join(self.columns) + self.newline)

    def rx(self, data: bytes, t: float) -> None:
        """Do nothing: a table has no place for it."""

    tx = rx

    def i2c(self, address: int, wrote: bytes, t: float, read: bytes = b"") -> None:
        """Do nothing: a table has no place for it."""

    def command(self, t: float, steering: float, throttle: float, source: str = "user") -> None:
        """Do nothing: a table has no place for it."""

    def applied(self, t: float, applied: object) -> None:
        """Do nothing: it is part of every State."""

    def hello(self, values: object) -> None:
        """Do nothing: a table has no place for it."""

    pose = hello

    def note(self, name: str, values: object) -> None:
        """Do nothing: a table has no place for it."""

    def _write_row(self, values: tuple[object, ...]) -> None:
        self._file.write(",".join(map(_format_cell, values)) + self.newline)

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()


class CsvWriter(_CsvWriter):
    """One row per State; floats are written so that they read back exactly."""

    columns = CSV_COLUMNS

    def state(self, s: State) -> None:
        """Write the row of a State."""
        a = s.applied
        p = s.pose
        self._write_row((s.t, s.seq, s.speed, s.speed_std, s.yaw_rate, s.accel_x, s.accel_y,
                         s.ticks, p.x, p.y, p.yaw, a.steering, a.throttle, a.steering_us,
                         a.throttle_us, "|".join(map(str, a.limited)),
                         "|".join(sorted(s.health.flags))))


def _steering_command(s: State) -> float:
    """Return the steering command in [-1, 1], 0 without a pulse: pulse = 1500 + 375 * command."""
    return ((s.applied.steering_us or 1500.0) - 1500.0) / 375.0


class DartCsvWriter(_CsvWriter):
    """The ten columns of the DART recordings (schema A), one row per State.

    The accelerations lack gravity, unlike theirs. ``safety_value`` is 1 while the car is armed.
    A State without a sample of the IMU gets the last one, as in theirs; zeros: it has no IMU.
    """

    columns = DART_COLUMNS
    newline = "\r\n"
    _imu: tuple[float, ...] = (0.0, 0.0, 0.0)

    def state(self, s: State) -> None:
        """Write the row of a State."""
        self._imu = tuple(held if value is None else value for held, value in zip(
            self._imu, (s.accel_x, s.accel_y, s.yaw_rate), strict=True))
        gate = 0.0 if "NOT_ARMED" in map(str, s.applied.limited) else 1.0
        self._write_row((s.t, 0.0, 0.0, *self._imu, abs(s.speed), gate, s.applied.throttle,
                         _steering_command(s)))


def _format_cell(value: object) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else repr(float(value)) if isinstance(
        value, float) else str(value)


def read_csv(path: Path | str) -> list[Row]:
    """Read the rows of ``CsvWriter``; an incomplete last row is dropped.

    Numbers as float or int, empty as None, ``limited`` and ``flags`` as tuples.
    Raises RecordingError naming the file.
    """
    path = Path(path)
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as why:
        raise RecordingError(f"{path}: cannot be read as CSV", found=str(why),
                             read=str(path)) from why
    # A program that was killed leaves a part of a row.
    whole = text[:text.rfind("\n") + 1]
    lines = csv.reader(whole.splitlines())
    header = tuple(next(lines, ()))
    if header != CSV_COLUMNS:
        raise RecordingError(f"{path}: not the columns of a run", read=str(path),
                             found=",".join(header)[:80] or "an empty file",
                             expected=",".join(CSV_COLUMNS))
    try:
        return [_parse_row(line) for line in lines]
    except ValueError as why:
        raise RecordingError(f"{path}: a cell is not a number", found=str(why),
                             read=str(path)) from why


def _parse_row(line: list[str]) -> Row:
    if len(line) != len(CSV_COLUMNS):
        raise ValueError(f"{len(line)} cells in a row of {len(CSV_COLUMNS)}")
    row: Row = {}
    for name, cell in zip(CSV_COLUMNS, line, strict=True):
        if name in _TEXT_COLUMNS:
            row[name] = tuple(cell.split("|")) if cell else ()
        elif name in _INTEGER_COLUMNS:
            row[name] = int(cell)
        else:
            row[name] = float(cell) if cell else None
    return row
