"""Terminal output of ``dart-hal data``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from dart_hal.cli.common.output import count_notices, print_line, print_verdict, results
from dart_hal.recording.check import DONE, CheckSummary, RecordingCheck, folder_of, stem_of
from dart_hal.recording.fetch import FetchOutcome
from dart_hal.recording.fetch.published import MANUAL_ADVICE
from dart_hal.recording.repair import Repaired
from dart_lab.report.numbers import significant

# More files are listed in a table, and only with their serious findings.
MAX_DETAILED_FILES = 3
# Missing files that are listed; more are counted.
MAX_LISTED_FILES = 5
# Words of a file name, between which a line may break. A date with time is one word.
WORD = re.compile(r"\d\d_\d\d_\d{4}_\d\d_\d\d_\d\d|[^_-]*[_-]|[^_-]+$")
# A terminal of 80 columns has 21 for a name; a wider one gives its extra columns to the name, up
# to 44, the length of the longest names.
NARROW_TERMINAL = 80
MIN_NAME_COLUMNS = 21
MAX_NAME_COLUMNS = 44


def show_checks(checks: Sequence[RecordingCheck], skipped: Sequence[tuple[str, str]],
                whole: CheckSummary, full: bool) -> None:
    """Print verdict, uses and first step in three lines, then a block for each of a few files or a
    table of many. Skipped files are counted unless ``full``.
    """
    usable = sum(bool(c.good_for) for c in checks)
    kinds = ", ".join(f"{n} of schema {s}" for s, n in whole.schemas.items())
    uses = ", ".join(f"{p} {n}" for p, n in whole.good_for.items() if n) or "nothing"
    verb = "is" if usable == 1 else "are"
    left = f"; {len(skipped)} file{'s' * (len(skipped) != 1)} skipped" if skipped else ""
    print_verdict(f"{usable} of {whole.files} recordings {verb} good for a fit or an evaluation, "
                  f"{significant(whole.duration)} s in total.",
                  f"good for: {uses}; {whole.windows} evaluation windows of 1 s; {kinds}{left}",
                  _first_step(checks), "bold" if usable else "bold red")
    # Recordings that differ, of two cars for example, spoil every fit of all of them.
    for note in whole.notes:
        print_line(f"caution: {note}", "yellow")
    if full or len(checks) <= MAX_DETAILED_FILES:
        for c in checks:
            _print_block(c)
    else:
        results.print(_make_table(checks))
        _print_serious(checks)
        _print_counts(checks)
    count_notices(tuple(f"skipped {path}: {reason}" for path, reason in skipped), full)


def _first_step(checks: Sequence[RecordingCheck]) -> str:
    """Return what to do first: look at a serious finding, or use the recordings."""
    # A serious finding may make every fit wrong.
    serious = [(c, finding) for c in checks for finding in c.findings if finding.serious]
    if serious:
        c, finding = serious[0]
        return f"look at {c.name}: {finding}"
    if any("evaluation" in c.good_for for c in checks):
        return "dart-hal evaluate FILES, then dart-hal diagnose --train FILES"
    return "dart-hal identify all FILES" if any(c.good_for for c in checks) else ""


def _print_block(c: RecordingCheck) -> None:
    """Print facts, findings, uses and verdict of one recording."""
    f = c.facts
    r = c.recording
    m = c.facts.mocap
    print_line(c.name, "bold")
    _print_line("what", f"schema {r.schema}, {f.duration:.1f} s, {f.rows or f.messages} rows, "
                f"{f.messages} messages every {f.step:.3f} s")
    _print_line("when", f"{f.date} by {f.date_from}" if f.date else "not known")
    _print_line("commands", f"throttle {_span(f.throttle)} while the gate is open, steering "
                f"{_span(f.steering)}")
    _print_line("motion", f"wheels {_span(f.speed, ' m/s')}, gyro {_span(f.yaw_rate, ' rad/s')}")
    quantum = (f", {r.quantum:.5f} m/s per count" + (f" = {f.marks} marks per shaft turn"
               if f.marks else "") if r.quantum else "")
    _print_line("encoder", r.encoder + quantum)
    if m is not None:
        _print_line("mocap", f"{m.rows} rows every {m.step:.3f} s, v_x {_span(m.v_x, ' m/s')}, "
                    f"yaw rate {_span(m.yaw_rate, ' rad/s')}; bad {m.bad:.1%}, "
                    f"false lock {m.false_lock:.1%}, {m.gaps} gap(s) up to "
                    f"{m.longest_gap:.2f} s, {m.outliers} outlier row(s)")
        _print_line("markers", _describe_marker_frame(c))
    for x in c.findings:
        print_line(f"  {'!' if x.serious else '-'} {x}", "yellow" if x.serious else "dim")
    for purpose, use in c.uses.items():
        print_line(f"  {'yes' if use.good else 'no':>5} {purpose:<10} {use.n:>5} {use.unit:<8} "
                   f"{use.why}",
                    "" if use.good else "dim")
    print_line(f"  {c.verdict}", "green" if c.good_for else "red")


def _describe_marker_frame(c: RecordingCheck) -> str:
    known = c.motion.reference
    fitted = c.motion.fitted
    text = f"{known} ({known.source})" if known else "not known, and not identified by this driving"
    if fitted and str(fitted) != str(known):
        text += f"; fitted to this recording alone: {fitted}"
    return text


def _make_table(checks: Sequence[RecordingCheck]) -> Table:
    table = Table(box=None, pad_edge=False)
    width = MIN_NAME_COLUMNS + min(max(results.width - NARROW_TERMINAL, 0),
                                   MAX_NAME_COLUMNS - MIN_NAME_COLUMNS)
    table.add_column("recording", no_wrap=True, min_width=MIN_NAME_COLUMNS)
    for name in ("schema", "s", "rows", "encoder", "m/s", "bad"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("good for", overflow="fold")
    folder = None
    for c in checks:
        f = c.facts
        path = c.recording.path
        if path.parent != folder:
            folder = path.parent
            table.add_row(f"[bold]{escape(wrap_name(folder_of(path), width))}[/]")
        top = f.speed or (f.mocap.v_x if f.mocap else None)
        stem = wrap_name(stem_of(path), width - 2).replace("\n", "\n  ")
        table.add_row("  " + escape(stem), c.recording.schema, f"{f.duration:.0f}",
                      str(f.rows or f.messages),
                      f"{f.marks} marks" if f.marks else c.recording.encoder,
                      f"{top[1]:.2f}" if top else "-",
                      f"{f.mocap.bad:.0%}" if f.mocap else "-",
                      ", ".join(c.good_for) or "nothing", style="" if c.good_for else "dim")
    return table


def wrap_name(name: str, width: int) -> str:
    """Break a name into lines of at most ``width`` characters, after _ or - if possible."""
    lines = [""]
    for word in WORD.findall(name):
        for piece in (word[i:i + width] for i in range(0, len(word), width)):
            if len(lines[-1]) + len(piece) > width:
                lines.append("")
            lines[-1] += piece
    return "\n".join(lines)


def _print_serious(checks: Sequence[RecordingCheck]) -> None:
    for c in checks:
        for x in c.findings:
            if x.serious:
                print_line(f"! {c.name}: {x}", "yellow")


def _print_counts(checks: Sequence[RecordingCheck]) -> None:
    """Print by kind what was dropped or changed in all files."""
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
    """Print the files that were refused, replaced or are missing, the total, and the remedy."""
    for r in outcome.refused:
        print_line(f"refused {r.path}: {r.found} ({r.where})", "red")
    for path in outcome.replaced:
        print_line(f"{path} had other content: kept as {path.rsplit('/', 1)[-1]}.old", "yellow")
    for path in outcome.missing[:MAX_LISTED_FILES]:
        print_line(f"missing {path}", "yellow")
    if len(outcome.missing) > MAX_LISTED_FILES:
        print_line(f"... and {len(outcome.missing) - MAX_LISTED_FILES} more", "yellow")
    there = len(outcome.present) + len(outcome.fetched)
    print_line(f"{there} of {outcome.files} recordings in {outcome.to} "
               f"({len(outcome.fetched)} new)",
               "green" if outcome.complete else "yellow")
    if not outcome.complete:
        print_line(f"to complete it: {MANUAL_ADVICE}")


def show_repair(done: Sequence[Repaired]) -> None:
    """Print how much was kept and removed, and the name of the old file."""
    for d in done:
        if d.old is None:
            print_line(f"{d.path}: complete, {d.messages} messages; not changed")
        else:
            print_line(f"{d.path}: {d.messages} messages, index written; {d.left_out} bytes of "
                       f"incomplete records are left out; the old file is {d.old.name}", "green")


def _span(values: tuple[float, float] | None, unit: str = "") -> str:
    return "none" if values is None else f"{_short(values[0])} to {_short(values[1])}{unit}"


def _short(value: float) -> str:
    return np.format_float_positional(value + 0.0, precision=3, trim="-")


def _print_line(name: str, text: str) -> None:
    print_line(f"  {name:<9} {text}")
