"""``dart-hal data import``: what it reads, checks, prints and writes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.table import Table as TextTable

from dart_hal.car.recorder import rename_existing
from dart_hal.cli.common.output import console, print_json, print_line, results
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.core.text_file import read_text
from dart_hal.recording.imported import (
    STREAM_COLUMNS,
    ImportedData,
    is_imported,
    write_imported,
)
from dart_lab.importing import (
    ImportFinding,
    check_data,
    convert_tables,
    guess_map,
    load_map,
    read_tables,
)


def guess_import(files: Sequence[Path], out: Path | None, as_json: bool) -> int:
    """Print a proposed map, or write it to ``out``."""
    if out is not None and out.suffix != ".toml":
        raise UsageError(f"{out} is no map", found=out.name, expected="a name that ends in .toml",
                         remedy="--guess --out map.toml, then --map map.toml --out run.mcap")
    found = guess_map(read_tables(files))
    if out is not None:
        kept = rename_existing(out)
        if kept is not None:
            console.print(f"{kept} is the map that was there", markup=False, highlight=False)
        out.write_text(found.text, encoding="utf-8")
    if as_json:
        print_json({"map": found.text, "evidence": found.evidence, "questions": found.questions,
                    "written": out})
        return 0
    if out is None:
        results.print(found.text, markup=False, highlight=False, end="")
    else:
        for line in found.evidence:
            print_line(line)
    for question in found.questions:
        console.print(f"to answer: {question}", style="yellow", markup=False, highlight=False)
    where = out or "map.toml"
    if out is not None:
        console.print(f"written: {out}", markup=False, highlight=False)
    console.print(f"next: check {where}, then dart-hal data import {shlex.join(map(str, files))} "
                  f"--map {where} --car NAME --out run.mcap", markup=False, highlight=False)
    return 0


def run_import(files: Sequence[Path], map_name: str, car: CarFiles | None, out: Path | None,
               unchecked: bool, as_json: bool) -> int:
    """Convert, check, and write the recording. Raises RecordingError for a contradiction."""
    mapping, text = load_map(map_name)
    tables = read_tables(files)
    data = convert_tables(tables, mapping, text,
                          None if car is None else read_text(car.folder / "car.toml"))
    findings = check_data(data)
    if not as_json:
        _show(data, findings)
    # Wrong signs, units or axes would be fitted like a property of the car: nothing is written
    # before they are right, or stated as intended.
    severe = [f for f in findings if f.severe]
    if severe and not unchecked:
        raise RecordingError(
            "the streams contradict each other", found="; ".join(f"{f.what}: {f.text}"
                                                                 for f in severe),
            read=", ".join(map(str, files)), expected="signs, units and axes of one car",
            remedy="; ".join(f.remedy for f in severe) + "; or --unchecked, if the car is so")
    stem = re.sub(r"(\.(gz|csv|tsv|txt|mcap|bag|db3|parquet|json))+$", "", files[0].name)
    target = out or Path(f"{stem}.mcap")
    if target.suffix != ".mcap":
        raise UsageError(f"{target} is no recording", found=target.name,
                         expected="a name that ends in .mcap", remedy="--out run.mcap")
    # An older import can be made again from its log. It would count twice in a folder, perhaps with
    # a wrong map, so it is replaced. A recording of another kind is kept under a number.
    replaced = target.is_file() and _is_import(target)
    old = None if replaced else rename_existing(target)
    write_imported(data, target)
    if as_json:
        print_json(_to_json(data, findings, target, old) | {"replaced": replaced})
        return 0
    if replaced:
        console.print(f"{target} is replaced: it was an import, which its log gives again",
                      markup=False, highlight=False)
    if old is not None:
        console.print(f"{old} is the recording that was there: it is no import, so it is kept",
                      markup=False, highlight=False)
    console.print(f"written: {target}", markup=False, highlight=False)
    if car is None:
        print_line("no car is named: its sizes are needed for a fit; dart-hal car new NAME, then "
                   "--car NAME", "yellow")
    console.print(f"next: dart-hal data check {shlex.quote(str(target))}", markup=False,
                  highlight=False)
    return 0


def _is_import(path: Path) -> bool:
    """Return whether a file is an import; a damaged file is none."""
    try:
        return is_imported(path)
    except RecordingError:
        return False


def _show(data: ImportedData, findings: Sequence[ImportFinding]) -> None:
    """Print the streams with their ranges, what was dropped, and the comparisons."""
    table = TextTable("stream", "rows", "rate [Hz]", "time [s]", "values", box=None)
    zero = min(float(s.t[0]) for s in data.streams.values())
    for name, stream in data.streams.items():
        values = ", ".join(f"{column} {low:.3g} to {high:.3g}" for column, low, high in zip(
            STREAM_COLUMNS[name], stream.values.min(axis=0), stream.values.max(axis=0),
            strict=True))
        table.add_row(name, str(len(stream.t)), f"{1.0 / stream.period:.1f}",
                      f"{stream.t[0] - zero:.2f} to {stream.t[-1] - zero:.2f}", values)
    results.print(table)
    for change in data.facts.get("changes", ()):  # type: ignore[attr-defined]
        print_line(f"dropped: {change}")
    for finding in findings:
        print_line(str(finding), "red" if finding.severe else "yellow" if finding.remedy else "")


def _to_json(data: ImportedData, findings: Sequence[ImportFinding], target: Path, old: Path | None
             ) -> dict[str, Any]:
    return {"written": target, "old": old, "drive": data.drive,
            "streams": {name: {"rows": len(s.t), "period_s": s.period,
                               "start_s": float(s.t[0]), "end_s": float(s.t[-1])}
                        for name, s in data.streams.items()},
            "changes": data.facts.get("changes", []),
            "checks": [{"what": f.what, "text": f.text, "remedy": f.remedy or None,
                        "severe": f.severe} for f in findings]}
