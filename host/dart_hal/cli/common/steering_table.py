"""A steering map on a terminal: some rows of it, what there is to say, and the result last."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table
from rich.text import Text

from dart_hal.calibration.result import SteeringResult
from dart_hal.cli.common.output import console, results

MOST_ROWS = 13
"""Rows of the map on a terminal, so that the result does not scroll away."""


def show(result: SteeringResult, plot: Path | None = None, *, outcome: bool = True) -> None:
    """Some rows of the map, the notes, the fit, and with ``outcome`` whether it is written."""
    results.print(_table(result))
    for note in result.brief or result.notes:
        style = "yellow" if note.startswith("caution:") else "dim"
        results.print(f"  {note}", style=style, markup=False, highlight=False)
    form = ", ".join(f"{name} {value:.4f}" for name, value in result.paper_form.items())
    results.print(f"five-parameter form: {form}")
    backlash = result.backlash
    results.print("backlash: not known from these data" if backlash is None else
                  f"backlash {backlash.value:.4f} +- {backlash.std:.4f} rad")
    results.print(f"residual {result.residual_rms:.5f} rad rms over {result.n} samples")
    if result.dropped:
        results.print(result.dropped)
    if plot is not None:
        console.print(f"picture: {plot}")
    if outcome:
        why = result.unwritten or "nothing written: a dry run"
        console.print(f"written: {result.written}" if result.written else why, markup=False)


def _table(result: SteeringResult) -> Table:
    rows = rows_shown(len(result.command))
    some = "" if len(rows) == len(result.command) else (
        f", {len(rows)} of {len(result.command)} points (--json has all)")
    table = Table(title=Text(f"steering map of {result.car}{some}"))
    for column in ("command", "pulse", "angle", "one sigma"):
        table.add_column(column, justify="right")
    for i in rows:
        pulse = "-" if result.pulse_us is None else f"{result.pulse_us[i]:.1f} us"
        table.add_row(f"{result.command[i]:+.3f}", pulse, f"{result.angle[i]:+.4f} rad",
                      f"{result.angle_std[i]:.4f} rad")
    return table


def rows_shown(points: int) -> list[int]:
    """At most MOST_ROWS indices of 0..points-1, evenly where that works, both ends included."""
    last = points - 1
    least = max(1, -(-last // (MOST_ROWS - 1)))
    even = [step for step in range(least, 2 * least + 1) if last % step == 0]
    if even:
        return list(range(0, points, even[0]))
    return sorted({round(i * last / (MOST_ROWS - 1)) for i in range(MOST_ROWS)})
