"""HTML page of ``dart-hal data check --html``: what recordings contain and are good for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.recording.check import PURPOSES, CheckSummary, RecordingCheck
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html, el, join, table

# Recordings with a picture under their details; each takes about 20 kB.
MAX_PICTURES = 40


def write_page(checks: Sequence[RecordingCheck], skipped: Sequence[tuple[str, str]],
               whole: CheckSummary, path: Path, *, command: str, answer: Mapping[str, Any]) -> Path:
    """Write the page. Errors: OSError."""
    first = _draw_speed(checks[0]) if len(checks) == 1 else _draw_uses(checks)
    rows = [(c.name, f"{c.facts.duration:.3g} s", ", ".join(c.good_for) or "nothing",
             str(sum(f.serious for f in c.findings) or "-")) for c in checks]
    return page.write(path, page.page(
        "check of recordings", f"Check of {len(checks)} recording{'' if len(checks) == 1 else 's'}",
        el("div", el("div", first), _verdict(checks, skipped, whole), class_="pair"), {
            "recordings": ("Recordings", table(
                ("recording", "lasts", "good for", "serious findings"), rows)),
            "details": ("Details", join(
                page.foldable(c.name, _details(c, i < MAX_PICTURES and len(checks) > 1))
                for i, c in enumerate(checks))),
            "made": ("How this was made", join([el("p", el("code", command)),
                                                page.download(answer, "check.json")]))}))


def _verdict(checks: Sequence[RecordingCheck], skipped: Sequence[tuple[str, str]],
             whole: CheckSummary) -> Html:
    """Return the box: how many recordings are good for something, and what was skipped."""
    # One recording is judged by its own sentence, several by their count.
    usable = sum(bool(c.good_for) for c in checks)
    lead = (f"{checks[0].verdict[:1].upper()}{checks[0].verdict[1:]}." if len(checks) == 1 else
            f"{usable} of {len(checks)} recordings are good for a fit or an evaluation.")
    return page.card(
        el("p", lead, class_="big"),
        el("p", f"{whole.duration:.0f} s, {whole.windows} evaluation windows of 1 s."),
        page.notices([*(f"skipped {path}: {reason}" for path, reason in skipped), *whole.notes]),
        good=usable > 0)


def _draw_uses(checks: Sequence[RecordingCheck]) -> Html:
    """Draw for each purpose how many recordings are good for it."""
    return charts.tabulate_bars("Recordings that are good for each purpose", ("recordings",), [
        charts.BarRow(purpose, "after", [float(sum(purpose in c.good_for for c in checks))])
        for purpose in PURPOSES])


def _draw_speed(c: RecordingCheck) -> Html:
    """Draw the speeds of encoder and motion capture over time."""
    messages = c.recording.messages
    grid = c.motion.grid
    t = messages.arrival if grid is not None else messages.arrival - messages.arrival[0]
    series = []
    entries = []
    if np.isfinite(messages.speed).any():
        series.append(_series(t, messages.speed, "after"))
        entries.append(("after", "encoder"))
    if grid is not None:
        series.append(_series(grid.t, np.where(grid.bad, np.nan, grid.v_x), "before"))
        entries.append(("before", "motion capture, without bad samples"))
    if not series:
        return el("p", "No speed was recorded.")
    return join([svg.legend(entries), page.figure("Speed", charts.draw_lines(
        "speed", "time [s]", "speed [m/s]", series))])


def _series(t: FloatArray, speed: FloatArray, style: str) -> charts.Series:
    """Return a curve of at most MAX_CURVE_POINTS points."""
    step = -(-len(t) // charts.MAX_CURVE_POINTS)
    return charts.Series(t[::step], speed[::step], np.full(len(t[::step]), math.nan), style,
                         marked=False)


def _details(c: RecordingCheck, with_picture: bool) -> Html:
    """Return purposes, findings and the speeds of one recording."""
    return join([
        el("p", f"{c.verdict}; schema {c.recording.schema}, {c.facts.messages} messages every "
                f"{c.facts.step:.3f} s."),
        table(("purpose", "usable", "amount", "why"),
              [(purpose, "yes" if use.good else "no", f"{use.n} {use.unit}", use.why)
               for purpose, use in c.uses.items()]),
        page.items(("serious: " if finding.serious else "") + str(finding)
                   for finding in c.findings),
        _draw_speed(c) if with_picture else Html()])
