"""Terminal output of ``dart-hal diagnose``: verdict, findings, errors by model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from dart_hal.cli.common.output import output, print_line, print_verdict, results
from dart_lab.diagnosis.report.compared import step_changes
from dart_lab.diagnosis.report.explain import describe_cause, describe_claim
from dart_lab.diagnosis.report.findings import list_findings
from dart_lab.diagnosis.report.overview import CONSTANT_VELOCITY, NOISE_FLOOR
from dart_lab.diagnosis.report.patterns import describe_pattern
from dart_lab.diagnosis.report.summary import (
    first_step,
    headline,
    motion_warnings,
    summary_lines,
)
from dart_lab.diagnosis.report.words import (
    CHANNEL_LABELS,
    channel,
    describe_moved,
    error_figure,
    excess,
    late_commands,
    outliers,
    possible,
    predictor,
)
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.identification.evaluation import CHANNELS as PREDICTED
from dart_lab.report.numbers import significant

# Warnings and findings without --full; with the verdict these are ten lines.
MAX_LINES = 7
# Width of the table in columns, also in a narrower terminal.
MIN_TABLE_WIDTH = 86
# Terminal width from which medians are printed as well. The table with a refit and causes is
# 109 columns wide with medians.
MEDIANS_MIN_WIDTH = 110
STAGE_TITLES = {"given": "given", "refitted": "refitted", "extended": "with causes"}


def show(d: Diagnosis) -> None:
    """Print verdict, errors and first step in three lines, then one line for each finding."""
    changes = _describe_errors(d)
    print_verdict(headline(d), changes and f"errors 1 s ahead on the test recordings: {changes}",
                  first_step(d))
    lines = [*motion_warnings(d), *(finding.line for finding in list_findings(d))]
    for line in lines[:MAX_LINES]:
        print_line(f"  {line}")
    if len(lines) > MAX_LINES:
        print_line(f"  and {len(lines) - MAX_LINES} more (--full)", style="dim")


def _describe_errors(d: Diagnosis) -> str:
    """"speed 0.392 -> 0.0443 m/s, ...": the model as given, and the last one."""
    first, last = (stage.horizons for stage in (d.stages[0], d.stages[-1]))
    errors = {name: [error_figure(horizons, "1.0", name) for horizons in (first, last)]
              for name in PREDICTED}
    return ", ".join(f"{channel(name)} {' -> '.join(map(significant, both[:len(d.compared)]))} "
                     f"{CHANNEL_LABELS[name][1]}" for name, both in errors.items()
                     if all(map(math.isfinite, both)))


def show_full(d: Diagnosis) -> None:
    """Print the verdict, all sentences on each finding, the errors by model, and all doubts."""
    print_line(headline(d), style="bold")
    for line in motion_warnings(d):
        print_line(f"  {line}", style="yellow")
    for line in summary_lines(d):
        print_line(f"  {line}")
    for claim in d.claims:
        print_line(f"parameters: {' '.join(describe_claim(claim).values())}")
    for i, cause in enumerate(d.causes):
        print_line(f"{i + 1}. {cause.effect}: {' '.join(describe_cause(d, i).values())}")
    for p in d.possible:
        if p.grade == "likely":
            print_line(f"not accepted: {possible(p)}", style="dim")
    others = [p.effect for p in d.possible if p.grade != "likely"]
    if others:
        print_line(f"not accepted, possible: {', '.join(others)}", style="dim")
    for u in d.unexplained:
        print_line(f"not explained: {describe_pattern(d, u)}", style="yellow")
    for o in d.outliers:
        print_line(f"single moments: {outliers(o)}", style="yellow")
    if d.late_commands:
        print_line(f"late commands: {late_commands(d.late_commands)}", style="yellow")
    if d.excesses:
        print_line(f"above the noise floor: {'; '.join(map(excess, d.excesses))}", style="yellow")
    _show_errors(d)
    if d.predictor is not None:
        print_line(predictor(d.predictor))
    for name, m in d.refitted.items():
        if m.doubt:
            print_line(f"refitted: {describe_moved(name, m)}", style="yellow")


def _show_errors(d: Diagnosis) -> None:
    """Print the errors 1 s ahead on the test recordings, and what each step changes."""
    known = [name for name in PREDICTED
             if math.isfinite(error_figure(d.stages[0].horizons, "1.0", name))]
    if not known:
        return
    floor = ["floor"] * bool(d.noise_floor)
    counted = any(c.counts for name in known for c in step_changes(d, name))
    medians = results.width >= MEDIANS_MIN_WIDTH
    print_line(f"errors 1 s ahead on the test recordings: RMSE{' (median)' * medians}; "
               + f"floor: {NOISE_FLOOR}; " * bool(floor) + f"const.: {CONSTANT_VELOCITY}; "
               + "with each step its change"
               + " and the recordings better:worse" * counted)
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for title in ("", *floor, "const.", *(STAGE_TITLES[name] for name in d.compared)):
        table.add_column(title, no_wrap=True)
    for name in known:
        held, given, *later = (_format_error(horizons, name, medians) for horizons in (
            d.ctrv, *(stage.horizons for stage in d.compared.values())))
        least = [significant(d.noise_floor[name])] if floor else []
        steps = (f"{error} {c.summary}"
                 for error, c in zip(later, step_changes(d, name), strict=False))
        table.add_row(f"{channel(name)} [{CHANNEL_LABELS[name][1]}]", *least, held, given, *steps)
    Console(file=output, emoji=False, markup=False, highlight=False,
            width=max(results.width, MIN_TABLE_WIDTH)).print(table)


def _format_error(horizons: Mapping[str, Any], name: str, median: bool) -> str:
    """Return the RMSE, with the median if requested: "0.137 (0.103)"."""
    typical = error_figure(horizons, "1.0", name, "median")
    note = f" ({significant(typical)})" if median and math.isfinite(typical) else ""
    return significant(error_figure(horizons, "1.0", name)) + note
