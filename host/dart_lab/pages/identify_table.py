"""Terminal output of ``dart-hal identify``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from rich import box
from rich.table import Table

from dart_hal.cli.common.output import count_notices, print_line, print_verdict, results
from dart_hal.vehicle.sets import PAPER, PER_DEGREE
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.outcome import Identification
from dart_lab.identification.write import SECTIONS, why_unsound
from dart_lab.report.numbers import shorten_list, significant, with_error

DEGREES = {"1/rad": "1/deg", "N/rad": "N/deg"}
# Numbers that differ from file to file in reasons that are otherwise the same.
NUMBER = re.compile(r"\d+(\.\d+)?(?= (?:step|m/s per count|mocap|row|false|gap|samples slip|"
                    r"change speed|s earlier))")
# Terminal width from which the loss is printed. It is the least informative column: the square
# of the RMSE.
LOSS_MIN_WIDTH = 90
# Files that are listed one by one; more are counted by reason.
MAX_LISTED_FILES = 20


def show(outcome: Identification, assumption: str = "", full: bool = False) -> None:
    """Print verdict, residuals and first step in three lines, then parameters and fits.

    assumption: about the sizes of the car, "" for none. full: print the files and every note.
    """
    print_verdict(_headline(outcome), _describe_residuals(outcome), _first_step(outcome))
    if assumption:
        print_line(assumption, "yellow")
    if full:
        _print_files(outcome)
    results.print(_make_parameter_table(outcome))
    results.print(_make_residual_table(outcome))
    for name, fit in outcome.fits.items():
        why = why_unsound(fit)
        if why:
            print_line(f"caution: {name}: {why}", "yellow")
    # A note on all of a joint fit, as that on the sizes of car.toml, is a result of it.
    notes = group_notes(outcome)
    joint = [note for note, names in notes.items() if len(names) == len(outcome.fits) > 1]
    for note in joint:
        print_line(note)
    count_notices(tuple(f"{', '.join(names)}: {note}" for note, names in notes.items()
                        if note not in joint), full)


def _headline(outcome: Identification) -> str:
    """Return the verdict: how many parameters were identified, and from how much data."""
    entries = [e for fit in _list_fits(outcome).values() for e in fit.parameters.values()]
    identified = sum(e.identifiable for e in entries)
    samples = sum(r.used for r in outcome.files.values())
    used = sum(1 for r in outcome.files.values() if r.used)
    return (f"{identified} of {len(entries)} parameters identified, from {samples} samples of "
            f"{used} of {len(outcome.files)} recordings.")


def _describe_residuals(outcome: Identification) -> str:
    """Return the residual of each fit."""
    found = [f"{name} {significant(fit.rmse)} {fit.unit}" for name, fit in
             _merge_joint_fits(outcome).items() if fit.n]
    return f"residuals (RMSE): {', '.join(found)}" if found else ""


def _first_step(outcome: Identification) -> str:
    """Return what to do first: about an unsound fit, an unknown parameter, or a test."""
    fits = _list_fits(outcome)
    # An unsound fit comes first: its parameters mean nothing.
    for name, fit in fits.items():
        if why := why_unsound(fit):
            return f"drive and record again for {name}: {why}"
    if list(fits) == ["tyres"]:
        return ("dart-hal identify all FILES, unless --base has the steering delay and map of "
                "this car: the tyres take both as exact")
    unknown = [f"{name}.{key}" for name, fit in fits.items() for key, e in fit.parameters.items()
               if not e.identifiable]
    if unknown:
        submodel = unknown[0].partition(".")[0].partition("_")[0]
        return (f"record a drive that determines {shorten_list(unknown)}: "
                f"dart-hal experiment {submodel}")
    return "dart-hal evaluate on recordings that were not used in this fit"


def _list_fits(outcome: Identification) -> dict[str, SubmodelFit]:
    """Return the fits without the repetition of both axles in one."""
    return {name: fit for name, fit in outcome.fits.items()
            if not (name == "tyres" and "tyres_front" in outcome.fits)}


def group_notes(outcome: Identification) -> dict[str, list[str]]:
    """Return each note once, with the sub-models that it is about."""
    found: dict[str, list[str]] = {}
    for name, fit in outcome.fits.items():
        for note in fit.notes:
            found.setdefault(note, []).append(name)
    return found


def _print_files(outcome: Identification) -> None:
    reports = outcome.files
    used = sum(1 for r in reports.values() if r.used)
    results.print(f"{used} of {len(reports)} file(s) used, "
                  f"{sum(r.used for r in reports.values())} samples used, "
                  f"{sum(r.dropped for r in reports.values())} left out", highlight=False)
    if len(reports) <= MAX_LISTED_FILES:
        lines = [f"  {file}: used {r.used}, left out {r.dropped}"
                 + (f": {'; '.join(r.why)}" if r.why else "") for file, r in reports.items()]
    else:
        # Count the files by reason. Numbers are replaced by N, and what follows a sub-model's
        # reason is dropped, so that files with the same reason are counted together.
        counts: dict[str, int] = {}
        for report in reports.values():
            for why in report.why:
                head, _, rest = why.removeprefix("caution: ").partition(":")
                kind = NUMBER.sub("N", head if head not in SECTIONS
                                  else f"{head}:{rest.partition(':')[0]}")
                counts[kind] = counts.get(kind, 0) + 1
        lines = [f"  {why}: {count} file(s)" for why, count in counts.items()]
        whole = sum(1 for report in reports.values() if not report.why)
        lines += [f"  every row used: {whole} file(s)"] if whole else []
        lines.append("  (--json lists every file)")
    for line in lines:
        style = "yellow" if "caution:" in line else "dim"
        results.print(line, style=style, markup=False, highlight=False)


def list_columns(outcome: Identification) -> tuple[str, str, str, str]:
    """Return the column titles of the parameters; the values are compared with the third."""
    return ("", "value", "paper" if outcome.compared == PAPER.name else "base", "identifiable")


def list_parameters(outcome: Identification) -> list[tuple[str, str, str, str]]:
    """Return the rows of the parameters, in the columns of ``list_columns``.

    The title row of a sub-model has no value. A value that is repeated in degrees has no name.
    """
    rows = []
    for name, fit in _list_fits(outcome).items():
        paper = outcome.published[name].values if name in outcome.published else {}
        rows.append((name, "", "", ""))
        for key, e in {**fit.parameters, **outcome.derived.get(name, {})}.items():
            compared = f"{paper[key]:.5g}" if key in paper else ""
            rows.append((key, f"{with_error(e.value, e.std)} {e.unit.strip('-')}", compared,
                         _is_identifiable(fit, key, e)))
            if e.unit in DEGREES:
                compared = f"{paper[key] / PER_DEGREE:.4f}" if key in paper else ""
                value = with_error(e.value / PER_DEGREE, e.std / PER_DEGREE)
                rows.append(("", f"{value} {DEGREES[e.unit]}", compared, ""))
    return rows


def list_residuals(outcome: Identification) -> list[dict[str, str]]:
    """Return one row for each fit, by column; a joint fit of several sub-models is one row."""
    papers = {name: p.rmse for name, p in outcome.published.items() if p.rmse is not None}
    return [{"sub-model": name, "n": str(fit.n),
             "rmse": f"{fit.rmse:.5f} {fit.unit:<3}" if fit.n else "-",
             **({"paper's": f"{papers[name]:.5f}" if name in papers else ""} if papers else {}),
             "loss": f"{fit.loss:.6g}" if fit.n else "-",
             "fit ok": "yes" if fit.sound else "NO", "CPU ms": f"{1e3 * fit.cpu_s:.1f}"}
            for name, fit in _merge_joint_fits(outcome).items()]


def _merge_joint_fits(outcome: Identification) -> dict[str, SubmodelFit]:
    """Return the fits by name; a joint fit of several sub-models is one."""
    # The sub-models of a joint fit share its residual and its end.
    fits = dict(outcome.fits)
    if outcome.joint is None or not fits:
        return fits
    first = next(iter(fits.values()))
    return {"all": replace(first, converged=all(f.converged for f in fits.values()),
                           at_bound=tuple(n for f in fits.values() for n in f.at_bound))}


def _make_parameter_table(outcome: Identification) -> Table:
    names = list_columns(outcome)
    table = _make_table("parameters, +- one standard error", names, (names[2],))
    for name, *cells in list_parameters(outcome):
        if not cells[0] and table.row_count:
            table.add_section()
        table.add_row(f"  {name}" if cells[0] and name else name, *cells,
                      style="dim" if not name else "bold" if not cells[0] else None)
    return table


def _make_residual_table(outcome: Identification) -> Table:
    rows = list_residuals(outcome)
    excluded = {"loss"} if results.width < LOSS_MIN_WIDTH else set()
    columns = [column for column in (rows[0] if rows else {}) if column not in excluded]
    table = _make_table("residuals", columns, ("n", "rmse", "paper's", "loss", "CPU ms"))
    for row in rows:
        table.add_row(*(row[column] for column in columns))
    return table


def _make_table(title: str, columns: Sequence[str], right: Sequence[str]) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        table.add_column(name, justify="right" if name in right else "left", no_wrap=True)
    return table


def _is_identifiable(fit: SubmodelFit, key: str, e: FittedParameter) -> str:
    if key in fit.at_bound:
        return "at bound"
    return "yes" if e.identifiable else "no"
