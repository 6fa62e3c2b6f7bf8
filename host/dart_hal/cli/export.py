"""``dart-hal export``: a recorded run as a table for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from dart_hal.car.export import WRITERS
from dart_hal.car.table import read_table
from dart_hal.cli.options import json_option
from dart_hal.cli.output import notices, print_json, results
from dart_hal.errors import UsageError


@click.command("export")
@click.argument("kind", type=click.Choice(tuple(WRITERS)), metavar="csv|parquet")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True,
              metavar="FILE", help="the table; replaces a file that is there")
@json_option
def command(kind: str, run: Path, out: Path, as_json: bool) -> None:
    """Write RUN as a table: a row per State, commands, and what the program logged.

    Parquet needs pyarrow (pip install 'dart-hal[table]') and has the unit of each column in its
    schema. An empty cell, in Parquet NaN, is what was not measured, asked or logged in that row.
    """
    if out.exists() and run.exists() and out.samefile(run):
        raise UsageError("the table would replace its recording", found=str(out),
                         expected="another name after --out", remedy=f"--out {run.stem}.{kind}")
    table = read_table(run)
    notices(table.run.notices)
    out.parent.mkdir(parents=True, exist_ok=True)
    WRITERS[kind](table, out)
    if as_json:
        print_json({"recording": run, "table": out, "rows": len(table), "columns": table.units})
    else:
        results.print(f"{out}: {len(table)} rows, {len(table.columns)} columns", markup=False,
                      highlight=False)
