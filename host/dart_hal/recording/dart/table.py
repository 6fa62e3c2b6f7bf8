"""Parse the text of a recording into a header and a table of floats; errors name the line."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.text_file import decode_text
from dart_hal.core.types import FloatArray
from dart_hal.recording.expansion import ExpandsTooFar, expand_gzip, refusal
from dart_hal.recording.regular import check_regular

from .schema import USED, detect, split_header

GZIP = b"\x1f\x8b"
# Share of unreadable rows above which a file is refused.
MAX_BAD_SHARE = 0.05


def read_content(path: Path) -> bytes:
    """Return the uncompressed bytes of ``path``.

    Errors: RecordingError for a missing file, a folder, a pipe or 0 bytes.
    """
    file = str(path)
    check_regular(path)
    try:
        raw = path.read_bytes()
        if raw[:2] == GZIP:
            raw = expand_gzip(raw)
    except ExpandsTooFar as err:
        raise refusal(file, str(err)) from err
    except (EOFError, gzip.BadGzipFile, zlib.error) as err:
        raise RecordingError(f"{file}: damaged gzip file", found=str(err), read=file,
                             remedy="copy the file again") from err
    except FileNotFoundError as err:
        folder = path.resolve().parent
        there = f"{folder} is there" if folder.is_dir() else f"no folder {folder}"
        raise RecordingError(f"{file}: no such file", read=file, found=f"nothing; {there}",
                             expected="a recording (.csv, .mcap) or a folder of them",
                             remedy="check the path; $DART_DATA is the folder of recordings"
                             ) from err
    except OSError as err:
        raise RecordingError(f"{file}: cannot be read", found=err.strerror or str(err), read=file,
                             remedy="check the path and its permissions") from err
    if not raw.strip():
        raise RecordingError(f"{file}: the file is empty", found=f"{len(raw)} bytes", read=file,
                             expected="a header line and rows of numbers",
                             likely="the recorder was stopped before the first row",
                             remedy="leave this file out")
    return raw


def decode_content(raw: bytes, file: str) -> str:
    """Decode the text of a file: Unicode, else the Windows encoding of western Europe.

    Errors: RecordingError for a binary one.
    """
    try:
        try:
            text = decode_text(raw)
        except UnicodeDecodeError:
            text = raw.decode("cp1252")
        if "\x00" in text[:65536]:
            raise ValueError("NUL byte")
    except ValueError as err:
        raise RecordingError(f"{file}: not a text file", found=f"first bytes {raw[:8].hex(' ')}",
                             expected="a CSV file of schema A, B or C", read=file,
                             remedy="give the CSV export; our own recordings end in .mcap") from err
    return text


def parse(path: Path) -> tuple[str, dict[str, FloatArray], list[tuple[str, int]]]:
    """Parse a file by ``parse_text``. Errors: also those of ``read_content``."""
    return parse_text(decode_content(read_content(path), str(path)), str(path))


def parse_text(text: str, file: str
               ) -> tuple[str, dict[str, FloatArray], list[tuple[str, int]]]:
    """Return schema, columns by name and dropped (reason, rows) of the text of a recording.

    Errors: RecordingError with the file and, if possible, the line.
    """
    head, _, body = text.partition("\n")
    names = split_header(head.rstrip("\r"))
    schema = detect(names, file)
    if not body.strip():
        raise RecordingError(f"{file}: a header but no rows", found="0 rows",
                             expected="at least one row of numbers", read=file,
                             remedy="leave this file out")
    dropped: list[tuple[str, int]] = []
    try:
        # Fast for a sound file. All others are read line by line, so that the error names the line.
        table = np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2, comments=None)
    except ValueError:
        table = None
    if table is None or table.shape[1] != len(names):
        table, dropped = _parse_by_line(body, names, USED[schema], file)
    columns = {n: table[:, i] for i, n in enumerate(names)}
    return schema, columns, dropped


def _parse_by_line(body: str, names: Sequence[str], used: Sequence[str], file: str
                   ) -> tuple[FloatArray, list[tuple[str, int]]]:
    """Parse a damaged file line by line, to name the line; drop an incomplete last line.

    Text in a column that is not used becomes NaN.
    """
    lines = [(i + 2, text) for i, text in enumerate(body.splitlines()) if text.strip()]
    rows: list[list[float]] = []
    for number, (line, text) in enumerate(lines):
        cells = text.split(",")
        if len(cells) != len(names):
            if number == len(lines) - 1 and len(cells) < len(names):
                return _table(rows, names, file), [("last line cut off", 1)]
            raise RecordingError(
                f"{file}: line {line} has {len(cells)} cells, the header has {len(names)}",
                found=repr(text[:80]), expected=f"{len(names)} numbers", read=file,
                remedy="repair or delete that line")
        rows.append([_number(cell, name, line, file) if name in used else _number_or_none(cell)
                     for cell, name in zip(cells, names, strict=True)])
    return _table(rows, names, file), []


def _table(rows: list[list[float]], names: Sequence[str], file: str) -> FloatArray:
    if not rows:
        raise RecordingError(f"{file}: no complete row", found="0 rows", read=file,
                             expected="at least one row of numbers", remedy="leave this file out")
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(names))


def _number(cell: str, name: str, line: int, file: str) -> float:
    """Return the number in a cell, NaN for an empty one. Errors: RecordingError for text."""
    text = cell.strip().strip('"').strip()
    if not text:
        return float("nan")
    try:
        return float(text)
    except ValueError as err:
        raise RecordingError(f"{file}: line {line}, column {name!r} is not a number",
                             found=repr(cell[:40]), expected="a number", read=file,
                             remedy="repair or delete that line") from err


def _number_or_none(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def keep_finite(columns: dict[str, FloatArray], used: Sequence[str], file: str
                ) -> tuple[dict[str, FloatArray], int]:
    """Return the rows with finite numbers in all used columns, and the number of other rows.

    Errors: RecordingError if these are more than 5 % of all rows.
    """
    # Only columns that are used: others may be empty.
    finite = np.all([np.isfinite(columns[c]) for c in used], axis=0)
    bad = int((~finite).sum())
    if bad > MAX_BAD_SHARE * len(finite):
        worst = max(used, key=lambda c: int((~np.isfinite(columns[c])).sum()))
        raise RecordingError(
            f"{file}: {bad} of {len(finite)} rows hold a cell that is not a finite number",
            found=f"most of them in column {worst!r}", read=file,
            expected=f"at most {MAX_BAD_SHARE:.0%} of the rows", remedy="leave this file out")
    return {c: columns[c][finite] for c in used}, bad
