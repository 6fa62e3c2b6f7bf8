"""A path as a CSV file: a header, then one point a row: ``x,y`` [m] and, if wanted, ``speed``."""

from __future__ import annotations

import csv
from math import isfinite
from pathlib import Path as File

import numpy as np

from dart_hal.control.paths import GAP, Path
from dart_hal.errors import UsageError

COLUMNS = ("x", "y")


def read_path(file: File) -> Path:
    """The spline through the points of a file; closed where the last row repeats the first.

    Other columns are left alone. Raises UsageError, naming the line, for a
    missing column, what is no finite number, a speed that is not above 0, and as
    ``Path.through``; FileNotFoundError.
    """
    with file.open(newline="", encoding="utf-8") as lines:
        rows = csv.DictReader(lines, skipinitialspace=True)
        header = [name.strip() for name in rows.fieldnames or ()]
        rows.fieldnames = header
        missing = [name for name in COLUMNS if name not in header]
        if missing:
            raise UsageError(f"{file} has no column {' and no column '.join(missing)}",
                             found=", ".join(header) or "an empty file",
                             expected="a first line with x,y or x,y,speed", read=str(file))
        wanted = (*COLUMNS, *(("speed",) if "speed" in header else ()))
        table = [[_number(row[name], name, rows.line_num, file) for name in wanted]
                 for row in rows]
    at = np.array(table, dtype=float).reshape(-1, len(wanted))
    closed = len(at) > 3 and float(np.hypot(*(at[-1, :2] - at[0, :2]))) < GAP
    at = at[:-1] if closed else at
    try:
        return Path.through(at[:, :2], closed=closed, speed=at[:, 2] if "speed" in header else None)
    except UsageError as why:
        why.read = str(file)
        raise


def _number(text: str | None, name: str, line: int, file: File) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = float("nan")
    if not isfinite(value) or (name == "speed" and value <= 0.0):
        raise UsageError(f"{file}, line {line}: {name} is no number that a path can have",
                         found=repr(text), expected="m/s above 0" if name == "speed" else "m",
                         read=str(file))
    return value
