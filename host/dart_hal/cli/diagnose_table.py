"""What ``dart-hal diagnose`` shows in the terminal: verdict, causes, gains, what is left."""

from __future__ import annotations

import math

from rich import box
from rich.console import Console
from rich.table import Table

from dart_hal.cli.output import output, results, say
from dart_hal.diagnose.report import sentence, structure, verdict
from dart_hal.diagnose.report.words import (
    CHANNELS,
    channel,
    claim,
    excess,
    interval,
    late_commands,
    moved,
    outliers,
    pooled,
    possible,
    predictor,
    quantity,
)
from dart_hal.diagnose.result import Diagnosis, Gained
from dart_hal.evaluate import CHANNELS as PREDICTED
from dart_hal.report.numbers import p_value, percent, significant

NARROWEST = 80
"""Columns that the table takes wherever it is printed."""
NEXT_BEST = 3


def show(d: Diagnosis) -> None:
    """Everything, the verdict first."""
    say(verdict(d), style="bold")
    for claimed in d.claims:
        say(f"parameters: {claim(claimed)}")
    if d.causes:
        Console(file=output, emoji=False, width=max(results.width, NARROWEST)).print(_causes(d))
        for i, cause in enumerate(d.causes):
            say(f"{i + 1}. {sentence(cause)}")
    for p in d.possible:
        say(f"possible, not shown: {possible(p)}", style="dim")
    for u in d.unexplained:
        say(f"not explained: {structure(u)}", style="yellow")
    for o in d.outliers:
        say(f"single moments: {outliers(o)}", style="yellow")
    if d.late_commands:
        say(f"late commands: {late_commands(d.late_commands)}", style="yellow")
    for e in d.excesses:
        say(f"above the noise floor: {excess(e)}", style="yellow")
    if d.withdrawn:
        say(f"named at first and withdrawn: {', '.join(d.withdrawn)}", style="dim")
    _errors(d)
    if d.predictor is not None:
        say(predictor(d.predictor))
    _moved(d)
    near = sorted((c for c in d.considered if math.isfinite(c.loss)), key=lambda c: -c.loss)
    for c in near[:NEXT_BEST]:
        say(f"considered: {c.effect} ({p_value(c.p_value)}): {c.why_not}", style="dim")


def _causes(d: Diagnosis) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for name in ("effect", "value", "P", "removes", "of the error of", "indistinguishable from"):
        table.add_column(name, no_wrap=name in ("effect", "value"))
    for c in d.causes:
        values = "\n".join(f"{k} {quantity(n)}" for k, n in c.parameters.items())
        table.add_row(c.effect, values, f"{c.probability:.2f}", _gain(c.gain),
                      channel(c.gain.channel), ", ".join(c.cannot_be_told_from) or "-")
    return table


def _errors(d: Diagnosis) -> None:
    """Base, extended, CTRV and noise floor at 1 s, in one line for each channel."""
    first, last = d.stages[0].horizons, d.stages[-1].horizons
    known = [name for name in PREDICTED if math.isfinite(pooled(first, "1.0", name))]
    same = not (d.causes or d.refitted)
    beside = any(math.isfinite(pooled(d.ctrv, "1.0", name)) for name in known)
    if known:
        say("errors at 1 s on the test recordings (RMSE): "
             + ("model" if same else "base -> extended")
             + (" | constant velocity (CTRV)" if beside else "")
             + (" | noise floor" if d.noise_floor else ""))
    for name in known:
        base, extended, held = (significant(pooled(of, "1.0", name))
                                for of in (first, last, d.ctrv))
        gain = d.gain.get(name)
        share = "" if not gain or same else (
            f", {_gain(gain)} less" if gain.test >= 0.0 else f", {percent(-gain.test)} more")
        say(f"  {channel(name)}: {base}{'' if same else f' -> {extended}'}"
             f"{f' | {held}' if beside else ''}"
             f"{f' | {significant(d.noise_floor[name])}' if d.noise_floor else ''}"
             f" {CHANNELS[name][1]}{share}")


def _gain(gain: Gained) -> str:
    """"61 % (57 % to 65 %)", without what is not known."""
    between = f" ({interval(gain)})" if math.isfinite(gain.low) else ""
    return f"{percent(gain.test)}{between}"


def _moved(d: Diagnosis) -> None:
    if d.refitted:
        say(f"refitted: {len(d.refitted)} parameter(s) of the base model", style="dim")
    for name, m in d.refitted.items():
        if m.doubt:
            say(f"  {moved(name, m)}", style="yellow")
