"""The tables of ``dart-hal identify``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from rich import box
from rich.table import Table

from dart_hal.cli.common.output import results
from dart_hal.vehicle.sets import PAPER, PER_DEGREE
from dart_lab.identification.fit import Estimate, Fit
from dart_lab.identification.outcome import Identification
from dart_lab.identification.write import SECTIONS, why_unsound
from dart_lab.report.numbers import with_error

DEGREES = {"1/rad": "1/deg", "N/rad": "N/deg"}
NUMBER = re.compile(r"\d+(\.\d+)?(?= (?:step|m/s per count|mocap|row|false|gap|samples slip|"
                    r"change speed|s earlier))")
"""What differs from file to file in reasons that are the same."""
SESSION = re.compile(r"20\d\d-\d\d-\d\d\b")
"""How a note on one session of many begins."""
NARROW = 90
"""Columns of a terminal below which the loss, the square of the rmse, is left out."""
MOST_FILES = 20
"""Files listed one by one; more are summed up by reason."""


def show(outcome: Identification, full: bool = False) -> None:
    """Files first, then the fits, so that the result does not scroll away.

    full: notes of every session also where there are many files.
    """
    _files(outcome)
    results.print(_parameters(outcome))
    results.print(_quality(outcome))
    for name, fit in outcome.fits.items():
        why = why_unsound(fit)
        if why:
            results.print(f"caution: {name}: {why}", style="yellow", markup=False, highlight=False)
    noted = notes(outcome)
    short = {} if full or len(outcome.files) <= MOST_FILES else {
        note: names for note, names in noted.items() if SESSION.match(note)}
    for note, names in noted.items():
        if note not in short:
            results.print(f"  {', '.join(names)}: {note}", style="dim", markup=False,
                          highlight=False)
    if short:
        results.print(f"  {len(short)} note(s) on single sessions: --full shows them, --json too",
                      style="dim", markup=False, highlight=False)


def notes(outcome: Identification) -> dict[str, list[str]]:
    """Each note once, with the sub-models that it is about."""
    found: dict[str, list[str]] = {}
    for name, fit in outcome.fits.items():
        for note in fit.notes:
            found.setdefault(note, []).append(name)
    return found


def _files(outcome: Identification) -> None:
    reports = outcome.files
    used = sum(1 for r in reports.values() if r.used)
    results.print(f"{used} of {len(reports)} file(s) used, "
                  f"{sum(r.used for r in reports.values())} samples used, "
                  f"{sum(r.dropped for r in reports.values())} left out", highlight=False)
    if len(reports) <= MOST_FILES:
        lines = [f"  {file}: used {r.used}, left out {r.dropped}"
                 + (f": {'; '.join(r.why)}" if r.why else "") for file, r in reports.items()]
    else:
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
        lines.append("  (--json tells it file by file)")
    for line in lines:
        style = "yellow" if "caution:" in line else "dim"
        results.print(line, style=style, markup=False, highlight=False)


def heads(outcome: Identification) -> tuple[str, str, str, str]:
    """Columns of ``parameters``; the third: what the values are compared with."""
    return ("", "value", "paper" if outcome.compared == PAPER.name else "base", "identifiable")


def parameters(outcome: Identification) -> list[tuple[str, str, str, str]]:
    """Rows of ``heads``; a sub-model's own row has no value, a value in degrees no name."""
    rows = []
    for name, fit in outcome.fits.items():
        if name == "tyres" and "tyres_front" in outcome.fits:
            continue  # the same values again
        paper = outcome.published[name].values if name in outcome.published else {}
        rows.append((name, "", "", ""))
        for key, e in {**fit.parameters, **outcome.derived.get(name, {})}.items():
            beside = f"{paper[key]:.5g}" if key in paper else ""
            rows.append((key, f"{with_error(e.value, e.std)} {e.unit.strip('-')}", beside,
                         _told(fit, key, e)))
            if e.unit in DEGREES:
                beside = f"{paper[key] / PER_DEGREE:.4f}" if key in paper else ""
                value = with_error(e.value / PER_DEGREE, e.std / PER_DEGREE)
                rows.append(("", f"{value} {DEGREES[e.unit]}", beside, ""))
    return rows


def quality(outcome: Identification) -> list[dict[str, str]]:
    """One row for each fit, by column; a joint fit is one, whatever it is of."""
    fits = dict(outcome.fits)
    if outcome.joint is not None and fits:
        first = next(iter(fits.values()))
        fits = {"all": replace(first, converged=all(f.converged for f in fits.values()),
                               at_bound=tuple(n for f in fits.values() for n in f.at_bound))}
    papers = {name: p.rmse for name, p in outcome.published.items() if p.rmse is not None}
    return [{"sub-model": name, "n": str(fit.n),
             "rmse": f"{fit.rmse:.5f} {fit.unit:<3}" if fit.n else "-",
             **({"paper's": f"{papers[name]:.5f}" if name in papers else ""} if papers else {}),
             "loss": f"{fit.loss:.6g}" if fit.n else "-",
             "fit ok": "yes" if fit.sound else "NO", "CPU ms": f"{1e3 * fit.cpu_s:.1f}"}
            for name, fit in fits.items()]


def _parameters(outcome: Identification) -> Table:
    names = heads(outcome)
    table = _columns("parameters, +- one standard error", names, (names[2],))
    for name, *cells in parameters(outcome):
        if not cells[0] and table.row_count:
            table.add_section()
        table.add_row(f"  {name}" if cells[0] and name else name, *cells,
                      style="dim" if not name else "bold" if not cells[0] else None)
    return table


def _quality(outcome: Identification) -> Table:
    rows = quality(outcome)
    left_out = {"loss"} if results.width < NARROW else set()
    shown = [column for column in (rows[0] if rows else {}) if column not in left_out]
    table = _columns("residuals", shown, ("n", "rmse", "paper's", "loss", "CPU ms"))
    for row in rows:
        table.add_row(*(row[column] for column in shown))
    return table


def _columns(title: str, columns: Sequence[str], right: Sequence[str]) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        table.add_column(name, justify="right" if name in right else "left", no_wrap=True)
    return table


def _told(fit: Fit, key: str, e: Estimate) -> str:
    if key in fit.at_bound:
        return "at bound"
    return "yes" if e.identifiable else "no"
