"""The tables of ``dart-hal evaluate``."""

from __future__ import annotations

import math
import re
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dart_hal.cli.common.output import console, output, results
from dart_lab.identification.evaluation import CHANNELS, HORIZONS, UNITS, Evaluation
from dart_lab.identification.evaluation.cases import LEFT_OUT, short

DIGITS = {"vx": 2, "vy": 3, "yaw_rate": 2, "position": 2, "yaw_deg": 1}
EXACT, ROOMY = ("vy", "yaw_deg"), 100
"""Channels that never get one digit more; columns of a terminal that has room for it."""
WIDTH, WIDEST = 16, 40
"""Columns of a name at 80 columns, and where there is room."""
NAMED = 3
"""Files of one kind that are named; above it they are counted."""
NARROWEST = 80
"""Columns that the table takes wherever it is printed."""
YEAR = re.compile(r"_20\d\d_")
HEADS = ("v_x", "v_y", "yaw rate", "position", "yaw")


def show(e: Evaluation, pictures: list[Path]) -> None:
    """Files that gave nothing, the rows, and what follows from them last."""
    _files(e)
    if caution(e):
        results.print(f"caution: {caution(e)}", style="yellow", markup=False, highlight=False)
    # a narrow terminal may break lines, but no number may lose its second half
    Console(file=output, emoji=False, width=max(results.width, NARROWEST)).print(_table(e))
    lead, *lines = gain(e)
    for line in (lead, *(f"  {line}" for line in lines)):
        results.print(line, markup=False, highlight=False)
    if e.limit is not None:
        results.print("how far the kinematic model reaches:")
        for sentence in e.limit.sentences():
            results.print(f"  {sentence}", markup=False, highlight=False)
    for picture in pictures:
        console.print(f"picture: {picture}", markup=False, highlight=False)


def _files(e: Evaluation) -> None:
    files = e.prepared.files
    unused: dict[str, list[str]] = {}
    for file, use in files.items():
        if not use.windows:
            unused.setdefault(use.why[0] if use.why else "no window", []).append(file)
    results.print(f"{len(e.prepared.cases)} of {len(files)} file(s) used, "
                  f"{e.prepared.windows} windows", highlight=False)
    for reason, names in unused.items():
        which = f" ({', '.join(map(short, names))})" if len(names) <= NAMED else ""
        results.print(f"  skipped {len(names)} file(s){which}: {reason}", style="dim",
                      markup=False, highlight=False)
    slow, bad = (sum(getattr(c.windows, kind) for c in e.prepared.cases)
                 for kind in ("slow", "bad"))
    results.print(f"  windows left out: {slow} start at 0.3 m/s or slower, {bad} hold bad samples",
                  style="dim", highlight=False)
    for case in e.prepared.cases:
        for why in files[case.file].why:
            if LEFT_OUT not in why:  # these are in the sum
                style = "yellow" if why.startswith("caution:") else "dim"
                results.print(f"  {short(case.file)}: {why}", style=style, markup=False,
                              highlight=False)


def caution(e: Evaluation) -> str:
    """A model is good on what it was fitted to; that must not pass for prediction. "": is none."""
    n, total = len(e.fitted_to), len(e.prepared.cases)
    if not n:
        return ""
    names = ", ".join(short(file) for file in e.fitted_to[:NAMED])
    more = f" and {n - NAMED} more" if n > NAMED else ""
    return f"{n} of {total} recordings are those that this model was fitted to: {names}{more}"


def _table(e: Evaluation) -> Table:
    table = Table(title=Text(f"{e.vehicle.name} ({e.vehicle.kind}) | constant velocity "
                             "(CTRV): RMSE, below it the median"),
                  box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 0, 0, 1))
    table.add_column("recording (1 s)", no_wrap=True)
    table.add_column("n", justify="right", no_wrap=True)
    for head, unit in zip(HEADS, UNITS, strict=True):
        table.add_column(f"{head}\n[dim]{unit}[/]", justify="right", no_wrap=True)
    width = min(WIDTH + max(results.width - ROOMY, 0), WIDEST)
    for file in e.model.slices:
        folder, _, name = short(file, WIDEST).rpartition("/")
        _rows(table, e, (folder[:width], YEAR.sub(" ", name)[:width]), 1.0, file)
    table.add_section()
    for horizon in HORIZONS:
        _rows(table, e, (f"all, at {horizon:g} s", ""), horizon, None)
    return table


def _rows(table: Table, e: Evaluation, label: tuple[str, str], horizon: float,
          file: str | None) -> None:
    where = e.model.slices[file] if file else slice(0, e.prepared.windows)
    for i, kind in enumerate(("rmse", "median")):
        ours, held = (getattr(score, kind)(horizon, file) for score in (e.model, e.ctrv))
        table.add_row(Text(label[i]), "" if i else str(where.stop - where.start),
                      *[_cell(ours[c], held[c], c) for c in CHANNELS], style="dim" if i else None)


def _cell(model: float, held: float, channel: str) -> str:
    """"model|CTRV", the model's green where it is the better one."""
    digits = DIGITS[channel] + (results.width >= ROOMY and channel not in EXACT)
    ours, theirs = _number(model, digits), _number(held, digits)
    return f"[green]{ours}[/]|{theirs}" if model < held else f"{ours}|{theirs}"


def _number(value: float, digits: int) -> str:
    """Without the leading zero: five pairs have to fit beside a name."""
    return f"{value:.{digits}f}".removeprefix("0") if math.isfinite(value) else "inf"


def gain(e: Evaluation) -> list[str]:
    """What the model gains over constant velocity (CTRV), with intervals."""
    gains = e.gain_over_ctrv(1.0)
    lines = ["change of the RMSE at 1 s against constant velocity (CTRV) (95 % over "
             f"{gains['vx'].blocks} {gains['vx'].unit}):"]
    for head, g in zip(HEADS, gains.values(), strict=True):
        if not math.isfinite(g.value):
            lines.append(f"{head}: diverged")
            continue
        between = (f" ({-g.high:+.0%} to {-g.low:+.0%})" if math.isfinite(g.low)
                   else " (too few for an interval)")
        lines.append(f"{head} {-g.value:+.0%}{between}")
    return lines
