"""The tables of ``dart-hal identify``."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from dart_hal.cli.output import console
from dart_hal.identify.fit import Estimate, Fit
from dart_hal.identify.outcome import Outcome
from dart_hal.identify.write import why_unsound

PER_DEGREE = math.pi / 180.0
DEGREES = {"1/rad": "1/deg", "N/rad": "N/deg"}
NUMBER = re.compile(r"\d+(\.\d+)?(?= (?:step|m/s per count|mocap|row|false|gap))")
"""What differs from file to file in reasons that are the same."""
MOST_FILES = 20
"""Files listed one by one; more are summed up by reason."""


def show(outcome: Outcome, pictures: list[Path]) -> None:
    """Files first, then the fits, so that the result does not scroll away."""
    _files(outcome)
    console.print(_parameters(outcome))
    console.print(_quality(outcome))
    for name, fit in outcome.fits.items():
        why = why_unsound(fit)
        if why:
            console.print(f"caution: {name}: {why}", style="yellow", markup=False, highlight=False)
    for note, names in _notes(outcome).items():
        console.print(f"  {', '.join(names)}: {note}", style="dim", markup=False, highlight=False)
    for picture in pictures:
        console.print(f"picture: {picture}", markup=False, highlight=False)


def _notes(outcome: Outcome) -> dict[str, list[str]]:
    """Each note once, with the sub-models that it is about."""
    found: dict[str, list[str]] = {}
    for name, fit in outcome.fits.items():
        for note in fit.notes:
            found.setdefault(note, []).append(name)
    return found


def _files(outcome: Outcome) -> None:
    reports = outcome.files
    used = sum(1 for r in reports.values() if r.used)
    console.print(f"{used} of {len(reports)} file(s) used, "
                  f"{sum(r.used for r in reports.values())} samples used, "
                  f"{sum(r.dropped for r in reports.values())} left out", highlight=False)
    if len(reports) <= MOST_FILES:
        lines = [f"  {file}: used {r.used}, left out {r.dropped}"
                 + (f": {'; '.join(r.why)}" if r.why else "") for file, r in reports.items()]
    else:
        counts: dict[str, int] = {}
        for report in reports.values():
            for why in report.why:
                kind = NUMBER.sub("N", why.partition(":")[0])
                counts[kind] = counts.get(kind, 0) + 1
        lines = [f"  {why}: {count} file(s)" for why, count in counts.items()]
        lines.append("  (--json tells it file by file)")
    for line in lines:
        console.print(line, style="dim", markup=False, highlight=False)


def _parameters(outcome: Outcome) -> Table:
    table = _columns("parameters, +- one standard error",
                     {"": "left", "value": "left", "paper": "right", "told": "left"})
    for name, fit in outcome.fits.items():
        if name == "tyres" and "tyres_front" in outcome.fits:
            continue  # the same values again
        paper = outcome.published[name].values if name in outcome.published else {}
        table.add_row(f"[bold]{name}[/]")
        for key, e in {**fit.parameters, **outcome.derived.get(name, {})}.items():
            beside = f"{paper[key]:.5g}" if key in paper else ""
            table.add_row(f"  {key}", f"{e.value:.5g} +- {_error(e.std)} {e.unit.strip('-')}",
                          beside, _told(fit, key, e))
            if e.unit in DEGREES:
                beside = f"{paper[key] * PER_DEGREE:.4f}" if key in paper else ""
                value = f"{e.value * PER_DEGREE:.4f} +- {_error(e.std * PER_DEGREE)}"
                table.add_row("", f"{value} {DEGREES[e.unit]}", beside, "", style="dim")
        table.add_section()
    return table


def _columns(title: str, columns: dict[str, Any]) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False)
    for name, side in columns.items():
        table.add_column(name, justify=side, no_wrap=True)
    return table


def _told(fit: Fit, key: str, e: Estimate) -> str:
    if key in fit.at_bound:
        return "at bound"
    return "yes" if e.identifiable else "no"


def _error(std: float) -> str:
    return f"{std:.2g}" if math.isfinite(std) else "unknown"


def _quality(outcome: Outcome) -> Table:
    table = _columns("residuals", {
        "sub-model": "left", "n": "right", "rmse": "right", "paper's": "right",
        "loss": "right", "sound": "left", "CPU ms": "right"})
    for name, fit in outcome.fits.items():
        paper = outcome.published[name].rmse if name in outcome.published else None
        table.add_row(name, str(fit.n), f"{fit.rmse:.5f} {fit.unit:<3}" if fit.n else "-",
                      "" if paper is None else f"{paper:.5f}", f"{fit.loss:.6g}" if fit.n else "-",
                      "yes" if fit.sound else "NO", f"{1e3 * fit.cpu_s:.1f}")
    return table
