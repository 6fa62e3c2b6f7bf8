"""Paths as text files: our CSV, and the centre lines and racelines of F1TENTH and TUM.

Our files have a header ``x,y`` [m] and, if wanted, ``speed`` [m/s]. Those of F1TENTH and of TUM's
trajectory optimisation have comments, of which the last names the columns with their units::

    # x_m, y_m, w_tr_right_m, w_tr_left_m
    # s_m; x_m; y_m; psi_rad; kappa_radpm; vx_mps; ax_mps2

Sources: github.com/f1tenth/f1tenth_racetracks; github.com/TUMFTM/racetrack-database and
global_racetrajectory_optimization.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np

from dart_hal.control.paths import MAX_GAP, Path
from dart_hal.core.errors import UsageError
from dart_hal.core.text_file import read_text
from dart_hal.core.types import MAX_COORDINATE, FloatArray

# Required columns of a path.
COLUMNS = ("x", "y")
# Suffix of a column of lengths and its unit [m]. Without one, metres are assumed.
UNIT_SCALES = {"": 1.0, "_m": 1.0, "_cm": 0.01, "_mm": 0.001}
# Names of a column of speeds [m/s].
SPEEDS = ("speed", "vx_mps", "speed_mps", "v_mps")
# Other names that a column of speeds may have; a limit that is not read would be exceeded.
LIKELY_SPEED = re.compile(r"(v|vx|vel|velocity|speed)([^a-z].*)?$", re.IGNORECASE)
# Between columns. A comma last: in some countries it is the decimal separator.
DELIMITERS = (";", "\t", ",")
# Largest extent of a path whose header names no unit [m]. The smallest circle of the car is 0.9 m
# wide, 90 in centimetres; the rooms in which a motion capture observes a car of 1:10 are less
# than 30 m wide.
MAX_UNNAMED_EXTENT = 60.0
# Largest number in a column of lengths, whatever its unit.
MAX_CELL = 1e8
# Largest length of a path [m]: the longest race track has 21 km.
MAX_LENGTH = 25e3
# Range of speeds [m/s]: below it a path never ends, and no car exceeds it.
SPEED_RANGE = (1e-3, 1e3)
# Of a track: distance from its last point to its first, in median distances of its points.
MAX_CLOSING_GAP = 2.0


@dataclass(frozen=True, slots=True)
class PathTable:
    """Cells of a path file. lines: number of the line of each row, from 1.

    is_track: the columns were named in a comment, as in files of F1TENTH and TUM.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    is_track: bool


def read_path(file: File) -> Path:
    """Read the points of a file and lay a spline through them.

    A path is closed if its last row repeats its first. Tracks of F1TENTH and TUM are also closed
    if the last point is followed by the first at the distance of neighbours.

    Other columns are ignored. Raises UsageError, naming the line, for a missing column, one that
    looks like a speed under another name, a cell
    that is no finite number, a speed that is not above 0, an extent that suggests centimetres,
    and as ``Path.through``; FileNotFoundError. Example::

        read_path(File("Spielberg_centerline.csv")).closed  # True
    """
    table = read_table(file)
    columns = choose_columns(table.header, file)
    values = np.array([[parse_cell(row, index, table.header[index], line, file)
                        for index, _ in columns]
                       for row, line in zip(table.rows, table.lines, strict=True)],
                      dtype=float).reshape(-1, len(columns)) * [unit for _, unit in columns]
    check_unit(values[:, :2], table.header[columns[0][0]], file)
    values, closed = close_loop(values, table.is_track)
    try:
        return Path.through(values[:, :2], closed=closed,
                            speed=values[:, 2] if len(columns) > 2 else None)
    except UsageError as why:
        why.read = str(file)
        raise


def read_table(file: File) -> PathTable:
    """Split a file into header and cells. Raises UsageError and FileNotFoundError."""
    try:
        text = read_text(file)
    except UnicodeDecodeError as error:
        raise UsageError(f"{file} is not a text file", found=str(error), read=str(file),
                         expected="CSV in UTF-8 or UTF-16",
                         remedy="save it as CSV in UTF-8") from error
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)
             if line.strip()]
    comments = [line.lstrip("# \t") for _, line in lines if line.startswith("#")]
    content = [(number, line) for number, line in lines if not line.startswith("#")]
    # The last comment that names x and y is the header, else the first line of content.
    named = [line for line in comments if has_columns(split_line(line, find_delimiter(line)))]
    if not named:
        named = [line for _, line in content[:1]]
        content = content[1:]
        comments = []
    delimiter = find_delimiter(named[-1]) if named else ","
    return PathTable(split_line(named[-1], delimiter) if named else (),
                     tuple(split_line(line, delimiter) for _, line in content),
                     tuple(number for number, _ in content), bool(comments))


def has_columns(header: Sequence[str]) -> bool:
    """Return whether a header names x and y."""
    return all(any(name + suffix in header for suffix in UNIT_SCALES) for name in COLUMNS)


def find_delimiter(line: str) -> str:
    """Return the first of ``DELIMITERS`` that a line contains."""
    return next((one for one in DELIMITERS if one in line), ",")


def split_line(line: str, delimiter: str) -> tuple[str, ...]:
    """Split a line into cells without surrounding spaces and quotes."""
    try:
        row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error:  # a cell of more than 128 kB, or a NUL: no number either
        row = [line[:80]]
    return tuple(cell.strip() for cell in row)


def choose_columns(header: Sequence[str], file: File) -> list[tuple[int, float]]:
    """Return index and unit of x, y and, if there is one, the speed. Raises UsageError."""
    found: list[tuple[int, float]] = []
    missing = []
    for name in COLUMNS:
        match = next(((header.index(name + suffix), unit) for suffix, unit in UNIT_SCALES.items()
                      if name + suffix in header), None)
        if match is None:
            missing.append(name)
        else:
            found.append(match)
    if missing:
        raise UsageError(f"{file} has no column {' and no column '.join(missing)}",
                         found=", ".join(header) or "an empty file", read=str(file),
                         expected="a first line with x,y or x,y,speed, or # x_m, y_m, ...",
                         remedy="write the names of the columns into the first line")
    speed = next((header.index(name) for name in SPEEDS if name in header), None)
    if speed is None and (likely := [name for name in header if LIKELY_SPEED.match(name)]):
        raise UsageError(f"{file}: column {likely[0]} looks like a speed and is none of its names",
                         found=", ".join(header), read=str(file),
                         expected=f"{', '.join(SPEEDS)} [m/s]",
                         remedy=f"name it {SPEEDS[0]}, in m/s, or remove the column")
    return found if speed is None else [*found, (speed, 1.0)]


def check_unit(points: FloatArray, name: str, file: File) -> None:
    """Raise UsageError for points (n, 2) that look like centimetres and do not name their unit,
    and for paths that no car drives."""
    max_coordinate = float(np.abs(points).max()) if len(points) else 0.0
    length = float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) else 0.0
    if max_coordinate > MAX_COORDINATE or length > MAX_LENGTH:
        raise UsageError(f"{file}: the path is too large", read=str(file),
                         found=f"{length:g} m long, a point at {max_coordinate:g} m",
                         expected=f"at most {MAX_LENGTH:g} m, within {MAX_COORDINATE:g} m of the "
                                  "origin", likely="another unit",
                         remedy="name the columns x_cm,y_cm or x_mm,y_mm")
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if extent > MAX_UNNAMED_EXTENT and name in COLUMNS:
        raise UsageError(f"{file}: is this path in metres?", read=str(file),
                         found=f"it is {extent:.4g} m wide if x and y are metres",
                         expected=f"at most {MAX_UNNAMED_EXTENT:g} m where the header names no "
                                  "unit", likely="the file is in centimetres or millimetres",
                         remedy="name the columns x_cm,y_cm or x_mm,y_mm; x_m,y_m if it is that "
                                "large")


def close_loop(values: FloatArray, is_track: bool) -> tuple[FloatArray, bool]:
    """Return the rows without a repeated last one, and whether the path is closed."""
    if len(values) <= 3:
        return values, False
    step = float(np.median(np.hypot(*np.diff(values[:, :2], axis=0).T)))
    gap = float(np.hypot(*(values[-1, :2] - values[0, :2])))
    # Files of tracks are rounded: a thousandth of a step is the same point.
    if gap < (max(MAX_GAP, 1e-3 * step) if is_track else MAX_GAP):
        return values[:-1], True
    return values, is_track and gap < MAX_CLOSING_GAP * step


def parse_cell(row: Sequence[str], index: int, name: str, line: int, file: File) -> float:
    """Convert a cell to a number. Raises UsageError if a path cannot have it."""
    text = row[index] if index < len(row) else None
    try:
        value = float(text or "")
    except ValueError:
        value = float("nan")
    low, high = SPEED_RANGE if name in SPEEDS else (-MAX_CELL, MAX_CELL)
    if not low <= value <= high:
        raise UsageError(f"{file}, line {line}: {name} is no number that a path can have",
                         found=repr(text if text is None else text[:80]),
                         expected=f"{low:g} to {high:g} {'m/s' if name in SPEEDS else 'm'}",
                         remedy="correct this line, or remove it", read=str(file))
    return value
