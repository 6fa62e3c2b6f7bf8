"""Terminal output of ``dart-hal evaluate``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dart_hal.cli.common.output import (
    console,
    count_notices,
    output,
    print_line,
    print_verdict,
    results,
)
from dart_lab.identification.evaluation import CHANNELS, ERROR_UNITS, HORIZONS, Evaluation
from dart_lab.identification.evaluation.cases import EXCLUDED, short
from dart_lab.report.numbers import describe_change, join_names, significant

# Horizon [s] of the verdict.
HEADLINE_HORIZON = 1.0
# Decimals of each channel at 80 columns.
DIGITS = {"vx": 2, "vy": 3, "yaw_rate": 2, "position": 2, "yaw_deg": 1}
# From this terminal width on all channels but FIXED_DIGITS have one decimal more.
WIDE_TERMINAL = 100
FIXED_DIGITS = ("vy", "yaw_deg")
# Columns of a recording's name at 80 columns, and in a wide terminal.
MIN_NAME_WIDTH = 16
MAX_NAME_WIDTH = 40
# Files that a line names; more are counted.
MAX_NAMED_FILES = 3
# Width of the table in columns, also in a narrower terminal.
MIN_TABLE_WIDTH = 80
YEAR = re.compile(r"_20\d\d_")
CHANNEL_TITLES = ("v_x", "v_y", "yaw rate", "position", "yaw")


def show(e: Evaluation, pictures: list[Path], assumption: str, full: bool) -> None:
    """Print verdict, errors and first step in three lines, then the table and the conclusions.

    assumption: about the sizes of the car, "" for none. What is not used is counted unless
    ``full``.
    """
    print_verdict(_headline(e), _describe_errors(e), _first_step(e))
    if assumption:
        print_line(assumption, "yellow")
    for text in list_cautions(e):
        print_line(f"caution: {text}", "yellow")
    # A narrow terminal may break lines, but the table must not cut a number.
    Console(file=output, emoji=False, width=max(results.width, MIN_TABLE_WIDTH)).print(
        _make_table(e))
    lead, *lines = describe_gains(e)
    for line in (lead, *(f"  {line}" for line in lines)):
        results.print(line, markup=False, highlight=False)
    if e.limit is not None:
        results.print("how far the kinematic model reaches:")
        for sentence in e.limit.sentences():
            results.print(f"  {sentence}", markup=False, highlight=False)
    for picture in pictures:
        console.print(f"picture: {picture}", markup=False, highlight=False)
    count_notices(tuple(_list_unused(e)), full)


def _headline(e: Evaluation) -> str:
    """Return the verdict: the error of the position, compared with constant velocity."""
    gain = e.gain_over_ctrv(HEADLINE_HORIZON)["position"]
    error = e.model.rmse(HEADLINE_HORIZON)["position"]
    if not (math.isfinite(error) and math.isfinite(gain.value)):
        return f"The model {e.vehicle.name} diverges within {HEADLINE_HORIZON:g} s."
    # A gain is a share of the error of constant velocity.
    compared = describe_change(1.0 - gain.value, 1.0 - gain.high, 1.0 - gain.low)
    return (f"The model {e.vehicle.name} predicts the position {HEADLINE_HORIZON:g} s ahead with "
            f"an error of {significant(error)} m (RMSE), {compared} than by constant velocity.")


def _describe_errors(e: Evaluation) -> str:
    """Return the errors of all channels, and the number of windows."""
    errors = e.model.rmse(HEADLINE_HORIZON)
    channels = ", ".join(f"{title} {significant(errors[c])} {unit}" for c, title, unit in zip(
        CHANNELS, CHANNEL_TITLES, ERROR_UNITS, strict=True))
    return (f"errors {HEADLINE_HORIZON:g} s ahead (RMSE): {channels}; {e.prepared.windows} windows "
            f"of {len(e.prepared.cases)} of {len(e.prepared.files)} recordings")


def _first_step(e: Evaluation) -> str:
    """Return what to do first."""
    if e.fitted_to:
        return "evaluate recordings that the model was not fitted to"
    worse = [title for title, gain in zip(
        CHANNEL_TITLES, e.gain_over_ctrv(HEADLINE_HORIZON).values(), strict=True)
        if not gain.value > 0.0]
    why = f", because constant velocity predicts {join_names(worse, 'and')} better" if worse else ""
    return f"dart-hal diagnose finds the cause of these errors{why}"


def _list_unused(e: Evaluation) -> Iterator[str]:
    """Yield a sentence for each kind of data that was not used, and each remark on a recording."""
    files = e.prepared.files
    unused: dict[str, list[str]] = {}
    for file, use in files.items():
        if not use.windows:
            unused.setdefault(use.why[0] if use.why else "no window", []).append(file)
    for reason, names in unused.items():
        which = f" ({', '.join(map(short, names))})" if len(names) <= MAX_NAMED_FILES else ""
        yield f"skipped {len(names)} file(s){which}: {reason}"
    slow, bad = (sum(getattr(c.windows, kind) for c in e.prepared.cases)
                 for kind in ("slow", "bad"))
    if slow or bad:
        yield f"windows left out: {slow} start at 0.3 m/s or slower, {bad} hold bad samples"
    for case in e.prepared.cases:
        # The line above counts those that are excluded.
        yield from (f"{short(case.file)}: {why}" for why in files[case.file].why
                    if EXCLUDED not in why)


def list_cautions(e: Evaluation) -> list[str]:
    """Return warnings of recordings that were used to fit the model, or that do not fit it.

    Errors on recordings of the fit do not measure prediction.
    """
    n = len(e.fitted_to)
    total = len(e.prepared.cases)
    if not n:
        return [*e.notes]
    names = ", ".join(short(file) for file in e.fitted_to[:MAX_NAMED_FILES])
    more = f" and {n - MAX_NAMED_FILES} more" if n > MAX_NAMED_FILES else ""
    return [f"{n} of {total} recordings are those that this model was fitted to: {names}{more}",
            *e.notes]


def _make_table(e: Evaluation) -> Table:
    table = Table(title=Text(f"{e.vehicle.name} ({e.vehicle.kind}) | constant velocity "
                             "(CTRV): RMSE, below it the median"),
                  box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 0, 0, 1))
    table.add_column("recording (1 s)", no_wrap=True)
    table.add_column("n", justify="right", no_wrap=True)
    for head, unit in zip(CHANNEL_TITLES, ERROR_UNITS, strict=True):
        table.add_column(f"{head}\n[dim]{unit}[/]", justify="right", no_wrap=True)
    width = min(MIN_NAME_WIDTH + max(results.width - WIDE_TERMINAL, 0), MAX_NAME_WIDTH)
    for file in e.model.slices:
        folder, _, name = short(file, MAX_NAME_WIDTH).rpartition("/")
        _add_rows(table, e, (folder[:width], YEAR.sub(" ", name)[:width]), 1.0, file)
    table.add_section()
    for horizon in HORIZONS:
        _add_rows(table, e, (f"all, at {horizon:g} s", ""), horizon, None)
    return table


def _add_rows(table: Table, e: Evaluation, label: tuple[str, str], horizon: float,
              file: str | None) -> None:
    """Add a row of RMSE values and one of medians; of all recordings if ``file`` is None."""
    where = e.model.slices[file] if file else slice(0, e.prepared.windows)
    for i, kind in enumerate(("rmse", "median")):
        model, ctrv = (getattr(score, kind)(horizon, file) for score in (e.model, e.ctrv))
        table.add_row(Text(label[i]), "" if i else str(where.stop - where.start),
                      *[_format_pair(model[c], ctrv[c], c) for c in CHANNELS],
                      style="dim" if i else None)


def _format_pair(model: float, ctrv: float, channel: str) -> str:
    """Return "model|CTRV", with the model's error in green if it is the smaller one."""
    digits = DIGITS[channel] + (results.width >= WIDE_TERMINAL and channel not in FIXED_DIGITS)
    ours, reference = (_format_number(value, digits) for value in (model, ctrv))
    return f"[green]{ours}[/]|{reference}" if model < ctrv else f"{ours}|{reference}"


def _format_number(value: float, digits: int) -> str:
    """Format without the leading zero: five pairs and a name must fit in 80 columns."""
    return f"{value:.{digits}f}".removeprefix("0") if math.isfinite(value) else "inf"


def describe_gains(e: Evaluation) -> list[str]:
    """Return the reduction of the RMSE compared with constant velocity (CTRV), with intervals."""
    gains = e.gain_over_ctrv(1.0)
    lines = ["change of the RMSE at 1 s against constant velocity (CTRV) (95 % over "
             f"{gains['vx'].blocks} {gains['vx'].unit}):"]
    for head, g in zip(CHANNEL_TITLES, gains.values(), strict=True):
        if not math.isfinite(g.value):
            lines.append(f"{head}: diverged")
            continue
        between = (f" ({-g.high:+.0%} to {-g.low:+.0%})" if math.isfinite(g.low)
                   else " (too few for an interval)")
        lines.append(f"{head} {-g.value:+.0%}{between}")
    return lines
