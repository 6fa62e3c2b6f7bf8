"""Tables of columns out of CSV files, ROS bags, MCAP files, LeRobot data sets, data frames."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart.table import decode_content, read_content

# Separators of columns, in the order in which they are tried.
DELIMITERS = (",", ";", "\t", "|", " ")
# Lines from which the separator is recognised.
SAMPLE_LINES = 20
# Names of a column that are listed in a message.
MAX_LISTED_NAMES = 40
# Length of a line or a cell that is quoted in a message.
MAX_QUOTED_LENGTH = 80
CSV_SUFFIXES = (".csv", ".csv.gz", ".txt", ".tsv", ".dat")
BAG_SUFFIXES = (".bag", ".mcap", ".db3")


@dataclass(frozen=True, slots=True)
class Table:
    """One table of a log.

    name: file name, or topic of a bag. columns: values (n,) by name; NaN where a cell is empty.
    text_columns: columns with text, by name, with the first such line and cell. source: file and
    its SHA-256. cut_line: number of a last line that was not written to its end, else 0.
    """

    name: str
    columns: Mapping[str, FloatArray]
    text_columns: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    source: tuple[str, str] = ("", "")
    cut_line: int = 0

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def read_tables(files: Iterable[str | Path]) -> list[Table]:
    """Read every table of files and folders.

    Accepted are CSV files (``.gz`` too), ROS 1 and ROS 2 bags, MCAP files, folders of a ROS 2 bag
    or of a LeRobot data set, and folders of such files.

    Raises RecordingError for a file that cannot be read, and if there is no table.
    """
    tables: list[Table] = []
    paths = [Path(file) for file in files]
    for path in paths:
        tables += _read_path(path)
    if not tables:
        raise RecordingError(
            "no table to import", read=", ".join(map(str, paths)),
            found="no " + ", ".join((*CSV_SUFFIXES, *BAG_SUFFIXES)),
            expected="CSV files, ROS bags, MCAP files or a LeRobot data set",
            remedy="name the files or their folder")
    return tables


def _read_path(path: Path) -> list[Table]:
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return _read_bag(path)
        if (path / "meta" / "info.json").is_file():
            return _read_lerobot(path)
        inside = sorted(f for f in path.rglob("*") if f.name.endswith(CSV_SUFFIXES + BAG_SUFFIXES))
        return [table for file in inside for table in _read_path(file)]
    if path.suffix in BAG_SUFFIXES:
        return _read_bag(path)
    if path.suffix == ".parquet":
        return [_read_parquet(path)]
    return [read_csv(path)]


def _read_bag(path: Path) -> list[Table]:
    from .bags import read_bag

    return read_bag(path)


def read_csv(path: Path) -> Table:
    """Read a CSV file with any separator, with or without a header line.

    Columns without a header are called "1", "2", .... Decimal commas are read where the separator
    is not a comma. Raises RecordingError, which names the line.
    """
    content = read_content(path)
    text = decode_content(content, str(path)).lstrip("\ufeff")
    digest = hashlib.sha256(content).hexdigest()
    lines = text.splitlines()
    # Lines of comments before the table, as "# t, x, y"; the last of them may be the header.
    first = next((i for i, line in enumerate(lines) if line.strip()
                  and not line.lstrip().startswith(("#", "%"))), len(lines))
    delimiter = _find_delimiter(lines[first:first + SAMPLE_LINES])
    names = _split(lines[first], delimiter) if first < len(lines) else []
    has_header = any(_number(cell, delimiter) is None for cell in names if cell)
    comment = lines[first - 1].lstrip("#% ") if first else ""
    if has_header:
        body = lines[first + 1:]
        offset = first + 2
    else:
        body = lines[first:]
        offset = first + 1
        commented = _split(comment, _find_delimiter([comment])) if comment else []
        names = (commented if len(commented) == len(names)
                 else [str(i + 1) for i in range(len(names))])
    rows = [(offset + i, line) for i, line in enumerate(body) if line.strip()]
    if not rows:
        raise RecordingError(f"{path}: a header but no rows", found="0 rows", read=str(path),
                             expected="at least one row of numbers", remedy="leave this file out")
    _check_names(names, path)
    columns, text_columns, cut_line = _parse_rows(rows, names, delimiter, path)
    return Table(path.name, columns, text_columns, (str(path), digest), cut_line)


def _check_names(names: Sequence[str], path: Path) -> None:
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise RecordingError(f"{path}: a column name occurs twice", found=", ".join(twice),
                             expected="every column once", read=str(path),
                             remedy="rename one of the two in the header line")


def _find_delimiter(lines: Sequence[str]) -> str:
    """Return the separator that divides all lines into the same number of cells.

    Of several, that with the most numbers, then the most cells: a decimal comma divides as well.
    """
    def rate_cells(delimiter: str) -> tuple[float, int]:
        rows = [_split(line, delimiter) for line in lines if line.strip()]
        if len({len(row) for row in rows}) != 1 or len(rows[0]) == 1:
            return 0.0, 0
        cells = [cell for row in rows[1:] or rows for cell in row]
        numbers = sum(_number(cell, delimiter) is not None for cell in cells)
        return numbers / len(cells), len(rows[0])

    best = max(DELIMITERS, key=rate_cells)
    if rate_cells(best)[1]:
        return best
    # Lines of different length: the separator that occurs most.
    return max(DELIMITERS, key=lambda d: sum(line.count(d) for line in lines))


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    cells = next(csv.reader([line], delimiter=delimiter), [])
    return [cell.strip() for cell in cells]


def _number(cell: str, delimiter: str) -> float | None:
    """Return a cell as a number, NaN if it is empty, None if it is text."""
    if not cell:
        return np.nan
    try:
        return float(cell.replace(",", ".") if delimiter != "," else cell)
    except ValueError:
        return {"true": 1.0, "false": 0.0}.get(cell.lower())


def _parse_rows(rows: Sequence[tuple[int, str]], names: Sequence[str], delimiter: str, path: Path
                ) -> tuple[dict[str, FloatArray], dict[str, tuple[int, str]], int]:
    """Return (columns, columns with text, number of a last line that is cut off, else 0).

    Fast if all cells are numbers, else cell by cell.
    """
    try:
        values = np.loadtxt(io.StringIO("\n".join(line for _, line in rows)), ndmin=2,
                            delimiter=None if delimiter == " " else delimiter, comments=None)
        if values.shape[1] == len(names):
            return {name: values[:, i] for i, name in enumerate(names)}, {}, 0
    except ValueError:
        pass  # a cell is empty or text
    out = np.full((len(rows), len(names)), np.nan)
    text: dict[str, tuple[int, str]] = {}
    cut_line = 0
    for i, (line, content) in enumerate(rows):
        cells = _split(content, delimiter)
        if len(cells) != len(names):
            if i == len(rows) - 1 and len(cells) < len(names):
                out = out[:i]  # the recorder was stopped within the last line
                cut_line = line
                break
            raise RecordingError(
                f"{path}: line {line} has {len(cells)} cells, the header has {len(names)}",
                found=repr(content[:MAX_QUOTED_LENGTH]), expected=f"{len(names)} cells",
                read=str(path), remedy="repair or delete that line")
        for k, cell in enumerate(cells):
            number = _number(cell, delimiter)
            if number is None:
                text.setdefault(names[k], (line, cell[:MAX_QUOTED_LENGTH]))
            else:
                out[i, k] = number
    return {name: out[:, i] for i, name in enumerate(names)}, text, cut_line


def table_from_frame(frame: Any, name: str = "frame") -> Table:
    """Return a pandas DataFrame as a table; columns of vectors become ``name[0]``, ``name[1]``.

    Time stamps become seconds since 1970.

    Example:
        >>> import pandas
        >>> table_from_frame(pandas.DataFrame({"t": [0.0, 0.1], "v": [1, 2]})).columns["v"]
        array([1., 2.])
    """
    columns: dict[str, FloatArray] = {}
    text: dict[str, tuple[int, str]] = {}
    for column in frame.columns:
        series = frame[column]
        if series.dtype.kind == "M":
            columns[str(column)] = series.to_numpy().astype("datetime64[ns]").astype(float) * 1e-9
        elif series.dtype.kind in "biuf":
            columns[str(column)] = series.to_numpy(dtype=np.float64)
        else:
            try:
                values = np.array(series.tolist(), dtype=np.float64)
            except (TypeError, ValueError):
                text[str(column)] = (1, str(series.iloc[0])[:MAX_QUOTED_LENGTH])
                columns[str(column)] = np.full(len(series), np.nan)
                continue
            flat = values.reshape(len(values), -1)
            # Cells with vectors become one column for each component.
            columns |= ({str(column): flat[:, 0]} if values.ndim == 1 else
                        {f"{column}[{i}]": flat[:, i] for i in range(flat.shape[1])})
    return Table(name, columns, text)


def _read_parquet(path: Path) -> Table:
    from dart_hal.car.table import missing_package_error

    try:
        import pandas as pd
    except ImportError as error:
        raise missing_package_error("pandas", "a Parquet file") from error
    table = table_from_frame(pd.read_parquet(path), path.name)
    return Table(table.name, table.columns, table.text_columns,
                 (str(path), hashlib.sha256(path.read_bytes()).hexdigest()))


def _read_lerobot(folder: Path) -> list[Table]:
    """Read each episode of a local LeRobot data set as a table."""
    tables = []
    for path in sorted((folder / "data").rglob("*.parquet")):
        table = _read_parquet(path)
        episode = table.columns.get("episode_index", np.zeros(len(table)))
        for number in np.unique(episode):
            rows = episode == number
            tables.append(Table(f"episode {int(number)}",
                                {name: values[rows] for name, values in table.columns.items()},
                                table.text_columns, table.source))
    return tables


def quote_names(names: Iterable[str]) -> str:
    """Return names in quotes, at most MAX_LISTED_NAMES of them."""
    listed = list(names)
    more = len(listed) - MAX_LISTED_NAMES
    text = ", ".join(repr(name) for name in listed[:MAX_LISTED_NAMES])
    return f"{text} and {more} more" if more > 0 else text
