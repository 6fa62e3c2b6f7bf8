"""The table of ``dart-hal diagnose --suggest``."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table

from dart_hal.cli.common.output import print_line, results
from dart_lab.diagnosis.report.next_drive import NOTHING_TO_SUGGEST
from dart_lab.diagnosis.suggest.result import Suggestion
from dart_lab.diagnosis.suggest.sharpen import ParameterDrive


def show_suggestions(suggestions: Sequence[Suggestion], drives: Sequence[ParameterDrive]) -> None:
    """Print what to drive next, what it would separate or measure, and the commands."""
    if not suggestions and not drives:
        print_line(NOTHING_TO_SUGGEST)
    for one in drives:
        print_line(f"suggested: {one.sentence()}", style="bold")
        for command in one.commands:
            print_line(f"  {command}")
        print_line(f"  by hand: {one.by_hand}", style="dim")
    for s in suggestions:
        print_line(f"suggested: {s.sentence()}", style="bold")
        if not s.drive:
            if s.by_hand:
                print_line(f"  by hand: {s.by_hand}", style="dim")
            continue
        print_line(f"  {s.description}, on a free floor of {s.space}, judged by {s.needs}")
        results.print(_make_table(s))
        if s.caution():
            print_line(f"  {s.caution()}", style="yellow")
        for command in s.commands:
            print_line(f"  {command}")
        program = "on a real car with --url" if s.commands else "with your own program"
        print_line(f"  {program}; then dart-hal diagnose with the new recording too"
                   + (" (drive within the motion capture volume)" if "capture" in s.needs else ""))
        if not s.enough:
            print_line(f"  by hand: {s.by_hand}", style="dim")


def _make_table(s: Suggestion) -> Table:
    table = Table(title="standard deviations between the two; share of simulated repeats in "
                        "which the true one fits better", title_justify="left",
                  box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("effect", "confounder", "these data", s.drive, "right"):
        table.add_column(name, justify="left" if name in ("effect", "confounder") else "right",
                         no_wrap=True)
    for p in s.pairs:
        table.add_row(p.effect, p.confounder, f"{p.before:.1f}", f"{p.after:.1f}",
                      f"{100.0 * p.right:.0f} %" if math.isfinite(p.right) else "-",
                      style=None if p.is_separated else "yellow")
    return table
