"""A run as a table: CSV, or Parquet with the units in its schema."""

from __future__ import annotations

import csv
from pathlib import Path

from dart_hal.car.table import TABLE_COLUMNS, RunTable, missing_package_error


def write_csv(table: RunTable, path: Path) -> None:
    """Write a header, then a row per State; floats read back exactly, NaN is an empty cell.

    Raises OSError.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table.columns)
        columns = [column.tolist() for column in table.columns.values()]
        for row in zip(*columns, strict=True):
            writer.writerow("" if cell != cell else cell for cell in row)  # NaN is not itself


def write_parquet(table: RunTable, path: Path) -> None:
    """Write Parquet with ``unit`` and ``meaning`` of each column, and the facts of the run.

    Raises UsageError without pyarrow, OSError.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise missing_package_error("pyarrow", "Parquet") from error
    fields = []
    arrays = []
    for name, unit in table.units.items():
        array = pa.array(table.columns[name], from_pandas=False)
        meaning = TABLE_COLUMNS[name].meaning if name in TABLE_COLUMNS else "logged"
        about = {"unit": unit, "meaning": meaning}
        fields.append(pa.field(name, array.type, metadata=about))
        arrays.append(array)
    facts = {f"run.{key}": value for key, value in table.run.meta.items()}
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=facts)), path)
