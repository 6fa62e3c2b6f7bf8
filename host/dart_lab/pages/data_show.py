"""What ``dart-hal data`` prints for people."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from dart_hal.cli.common.output import print_line, results
from dart_hal.recording.check import DONE, CheckSummary, RecordingCheck, folder_of, stem_of
from dart_hal.recording.fetch import FetchOutcome
from dart_hal.recording.fetch.published import MANUAL_ADVICE
from dart_hal.recording.repair import Repaired

DETAILED = 3  # files; above it a table, and only what is serious
FIRST = 5
WORD = re.compile(r"\d\d_\d\d_\d{4}_\d\d_\d\d_\d\d|[^_-]*[_-]|[^_-]+$")
"""Of a file name: a date and time stays in one piece."""
NARROW, NAME, LONGEST = 80, 21, 44
"""Columns of a narrow terminal, of a name there, and of the longest that is worth its room."""


def show_checks(checks: Sequence[RecordingCheck], skipped: Sequence[tuple[str, str]],
                whole: CheckSummary, full: bool) -> None:
    """Blocks for a few files, a table for many; the verdicts last."""
    if full or len(checks) <= DETAILED:
        for c in checks:
            _block(c)
    else:
        results.print(_table(checks))
        _serious(checks)
        _counts(checks)
    for path, reason in skipped:
        print_line(f"skipped {path}: {reason}", "yellow")
    for note in whole.notes:
        print_line(f"note: {note}", "yellow")
    kinds = ", ".join(f"{n} of schema {s}" for s, n in whole.schemas.items())
    uses = ", ".join(f"{p} {n}" for p, n in whole.good_for.items() if n) or "nothing"
    print_line(f"{whole.files} recording(s) ({kinds}), {whole.duration:.0f} s, {whole.windows} "
                f"evaluation windows; good for: {uses}")


def _block(c: RecordingCheck) -> None:
    f, r, m = c.facts, c.recording, c.facts.mocap
    print_line(c.name, "bold")
    _line("what", f"schema {r.schema}, {f.duration:.1f} s, {f.rows or f.messages} rows, "
          f"{f.messages} messages every {f.step:.3f} s")
    _line("when", f"{f.date} by {f.date_from}" if f.date else "not known")
    _line("commands", f"throttle {_span(f.throttle)} while the gate is open, steering "
          f"{_span(f.steering)}")
    _line("motion", f"wheels {_span(f.speed, ' m/s')}, gyro {_span(f.yaw_rate, ' rad/s')}")
    quantum = (f", {r.quantum:.5f} m/s per count" + (f" = {f.marks} marks per shaft turn"
               if f.marks else "") if r.quantum else "")
    _line("encoder", r.encoder + quantum)
    if m is not None:
        _line("mocap", f"{m.rows} rows every {m.step:.3f} s, v_x {_span(m.v_x, ' m/s')}, yaw rate "
              f"{_span(m.yaw_rate, ' rad/s')}; bad {m.bad:.1%}, false lock {m.false_lock:.1%}, "
              f"{m.gaps} gap(s) up to {m.longest_gap:.2f} s, {m.outliers} outlier row(s)")
        _line("markers", _reference(c))
    for x in c.findings:
        print_line(f"  {'!' if x.serious else '-'} {x}", "yellow" if x.serious else "dim")
    for purpose, use in c.uses.items():
        print_line(f"  {'yes' if use.good else 'no':>5} {purpose:<10} {use.n:>5} {use.unit:<8} "
                   f"{use.why}",
                    "" if use.good else "dim")
    print_line(f"  {c.verdict}", "green" if c.good_for else "red")


def _reference(c: RecordingCheck) -> str:
    known, fitted = c.motion.reference, c.motion.fitted
    text = f"{known} ({known.source})" if known else "not known, and not identified by this driving"
    if fitted and str(fitted) != str(known):
        text += f"; fitted to this recording alone: {fitted}"
    return text


def _table(checks: Sequence[RecordingCheck]) -> Table:
    table = Table(box=None, pad_edge=False)
    width = NAME + min(max(results.width - NARROW, 0), LONGEST - NAME)
    table.add_column("recording", no_wrap=True, min_width=NAME)
    for name in ("schema", "s", "rows", "encoder", "m/s", "bad"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("good for", overflow="fold")
    folder = None
    for c in checks:
        f, path = c.facts, c.recording.path
        if path.parent != folder:
            folder = path.parent
            table.add_row(f"[bold]{escape(broken(folder_of(path), width))}[/]")
        top = f.speed or (f.mocap.v_x if f.mocap else None)
        stem = broken(stem_of(path), width - 2).replace("\n", "\n  ")
        table.add_row("  " + escape(stem), c.recording.schema, f"{f.duration:.0f}",
                      str(f.rows or f.messages),
                      f"{f.marks} marks" if f.marks else c.recording.encoder,
                      f"{top[1]:.2f}" if top else "-",
                      f"{f.mocap.bad:.0%}" if f.mocap else "-",
                      ", ".join(c.good_for) or "nothing", style="" if c.good_for else "dim")
    return table


def broken(name: str, width: int) -> str:
    """A name in lines of at most ``width``, broken behind _ or - where it has one."""
    lines = [""]
    for word in WORD.findall(name):
        for piece in (word[i:i + width] for i in range(0, len(word), width)):
            if len(lines[-1]) + len(piece) > width:
                lines.append("")
            lines[-1] += piece
    return "\n".join(lines)


def _serious(checks: Sequence[RecordingCheck]) -> None:
    for c in checks:
        for x in c.findings:
            if x.serious:
                print_line(f"! {c.name}: {x}", "yellow")


def _counts(checks: Sequence[RecordingCheck]) -> None:
    """What was dropped or changed in all files, by kind."""
    kinds: dict[str, list[int]] = {}
    for c in checks:
        for x in c.findings:
            if x.effect != "said":
                kinds.setdefault(DONE.get(x.kind, x.kind), []).append(x.rows)
    for done, rows in sorted(kinds.items(), key=lambda item: -len(item[1])):
        total = f", {sum(rows)} row(s)" if sum(rows) else ""
        print_line(f"{done} ({len(rows)} file(s){total})", "dim")
    print_line("(--full lists every finding of every file, --json has them for machines)", "dim")


def show_fetch(outcome: FetchOutcome) -> None:
    """What came, what was refused, what is missing and what to do about it."""
    for r in outcome.refused:
        print_line(f"refused {r.path}: {r.found} ({r.where})", "red")
    for path in outcome.replaced:
        print_line(f"another {path} was there: kept as {path.rsplit('/', 1)[-1]}.old", "yellow")
    for path in outcome.missing[:FIRST]:
        print_line(f"missing {path}", "yellow")
    if len(outcome.missing) > FIRST:
        print_line(f"... and {len(outcome.missing) - FIRST} more", "yellow")
    there = len(outcome.present) + len(outcome.fetched)
    print_line(f"{there} of {outcome.files} recordings in {outcome.to} ({len(outcome.fetched)} "
               "new)",
                "green" if outcome.complete else "yellow")
    if not outcome.complete:
        print_line(f"to complete it: {MANUAL_ADVICE}")


def show_repair(done: Sequence[Repaired]) -> None:
    """What was kept, what was left out, where the old file is."""
    for d in done:
        if d.old is None:
            print_line(f"{d.path}: whole, {d.messages} messages; left as it is")
        else:
            print_line(f"{d.path}: {d.messages} messages, index written; {d.left_out} bytes that "
                       "were "
                        f"not whole are left out; the old file is {d.old.name}", "green")


def _span(values: tuple[float, float] | None, unit: str = "") -> str:
    return "none" if values is None else f"{_short(values[0])} to {_short(values[1])}{unit}"


def _short(value: float) -> str:
    return np.format_float_positional(value + 0.0, precision=3, trim="-")


def _line(name: str, text: str) -> None:
    print_line(f"  {name:<9} {text}")
