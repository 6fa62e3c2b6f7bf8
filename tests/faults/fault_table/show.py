"""The table as it is printed."""

from __future__ import annotations

import math

from rich.console import Console
from rich.table import Table

from fault_table.judge import How, Verdict
from fault_table.layers import LAYERS
from fault_table.row import Measured, Row

WIDTH = 150
console = Console(width=WIDTH, highlight=False)
_COLUMNS = f"{'row':>3}  {'fault':<44} {'world':<5} {'case':<26} {'limit':>12} {'measured':>12} "


def figure(measured: Measured | None, unit: str) -> str:
    """A figure for people: nan is a measurement that broke down, inf never."""
    if measured is None:
        return "-"
    if math.isnan(measured.value):
        return "broke down"
    if math.isinf(measured.value):
        return "never"
    return f"{measured.value:.4g} {unit}"


def header(how: How) -> None:
    if how.removed:
        console.print(f"without {', '.join(how.removed)}: red is what must be found", style="bold")
    console.print(_COLUMNS + "       without its layer", style="bold")


def line(row: Row, verdict: Verdict) -> None:
    case = verdict.case
    control = ""
    if verdict.control is not None:
        control = f"{figure(verdict.control, case.unit)} without {' + '.join(case.control)}"
        control += "" if verdict.proves else " (control GREEN)"
    console.print(
        f"{row.number:>3}  {row.fault[:44]:<44} {case.world:<5} {case.what[:26]:<26} "
        f"{case.limit:>8.4g} {case.unit[:6]:<5}{figure(verdict.measured, case.unit):>11} "
        f"{'ok ' if verdict.holds else 'RED':<4} {control}",
        style=None if verdict.is_green else "red", markup=False, overflow="ignore", no_wrap=True,
        soft_wrap=True)
    if not verdict.is_green:
        for measured, name in ((verdict.measured, "measured"), (verdict.control, "control")):
            if measured is not None and measured.detail:
                console.print(f"       {name}: {measured.detail}", style="red", markup=False)


def summary(verdicts: list[tuple[Row, Verdict]], seconds: float) -> None:
    red = [f"{row.number} {v.case.world} {v.case.what}" for row, v in verdicts if not v.holds]
    green = [f"{row.number} {v.case.world} {v.case.what}" for row, v in verdicts if not v.proves]
    console.print(f"{len(verdicts)} cases in {seconds:.0f} s: {len(red)} red, "
                  f"{len(green)} controls green", style="bold")
    for title, names in (("red", red), ("control green", green)):
        for name in names:
            console.print(f"  {title}: {name}", markup=False)


def layers() -> None:
    table = Table("layer", "what it does", "what is taken away")
    for layer in LAYERS.values():
        where = layer.target or ", ".join(change[0] for change in layer.changes)
        table.add_row(layer.name, layer.does, where)
    console.print(table)
