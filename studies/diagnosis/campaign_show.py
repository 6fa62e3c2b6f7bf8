"""The table of the campaign beside its targets, and who was taken for whom as a picture."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from rich.table import Table

from studies.diagnosis.campaign_score import PROTOTYPE, TARGETS, Row
from studies.diagnosis.stranger_causes import CAUSES

NOBODY = ("unexplained", "nothing")
RIGHT, WRONG = "#1f5f9e", "#c0504d"
COLOURS = {"unexplained": "#9a9a9a", "nothing": "#e4e4e4"}


def table(rows: Sequence[Row]) -> Table:
    """One line per group; "right" of null is silence, of far "unexplained", of near the family.

    "alone": right and nothing beside it. "and more": share of the cases with a cause named that is
    not hidden, besides or instead. "held": 90 % intervals of sizes that hold what is hidden.
    """
    out = Table(title="Hidden causes, found from files")
    for title in ("hidden", "n", "right", "90 %", "target", "wrong", "missed", "alone",
                  "and more", "size off", "held", "s/case", "ok"):
        out.add_column(title, justify="left" if title == "hidden" else "right")
    for r in rows:
        target = TARGETS.get(r.group, {})
        aim = ", ".join(([f">= {target['right']:.2f}"] if "right" in target else [])
                        + ([f"wrong <= {target['wrong']:.2f}"] if "wrong" in target else []))
        size = "" if math.isnan(r.sizes[0]) else f"{r.sizes[0]:.0%} ({r.sizes[1]:.0%})"
        low, high = r.interval
        out.add_row(r.group, str(r.n), f"{r.shares['right']:.3f}", f"{low:.2f}-{high:.2f}", aim,
                    f"{r.shares['wrong']:.3f}", f"{r.shares['missed']:.3f}", f"{r.alone:.3f}",
                    f"{r.extra:.3f}",
                    size, "{} of {}".format(*r.held) if r.held[1] else "",
                    f"{r.seconds:.1f}", {True: "yes", False: "NO", None: ""}[r.ok])
    return out


BINS = (0.8, 0.9, 0.97, 0.99, 1.0)
"""Bounds of stated probabilities; the last bin holds 1 alone."""


def reliability(grades: Sequence[tuple[float, bool]]) -> Table:
    """Of names with a stated probability, how many were right."""
    found = Table(title="Stated probability against the share that was right")
    for head in ("P", "names", "mean P", "right"):
        found.add_column(head, justify="right")
    for low, high in pairwise((*BINS, 2.0)):
        here = [(p, right) for p, right in grades if low <= p < high]
        if here:
            share = sum(right for _, right in here) / len(here)
            found.add_row(f"{low:g} to {high:g}" if high <= 1.0 else f"{low:g}", str(len(here)),
                          f"{sum(p for p, _ in here) / len(here):.3f}", f"{share:.3f}")
    return found


def errors(matrix: Mapping[str, Counter[str]]) -> Table:
    """What was taken for something else, or not seen."""
    out = Table(title="Confused")
    out.add_column("hidden")
    out.add_column("named instead")
    for truth in sorted(matrix):
        wrong = [f"{name} {n}" for name, n in matrix[truth].most_common() if name != truth]
        if wrong:
            out.add_row(truth, ", ".join(wrong))
    return out


def picture(matrix: Mapping[str, Counter[str]], path: Path) -> Path:
    """A bar for each hidden cause: what it was called, wrong names in words. Needs matplotlib."""
    from dart_hal.core.figures import new_figure, save_figure

    hidden = [name for name in CAUSES if name in matrix]
    figure = new_figure((8.0, 1.5 + 0.24 * len(hidden)), path)
    axes: Any = figure.subplots()
    for i, truth in enumerate(hidden):
        row, left = matrix[truth], 0.0
        wrong = sorted(n for n in row if n not in (truth, *NOBODY))
        for name in (truth, *wrong, *NOBODY):
            share = 100.0 * row[name] / row.total()
            axes.barh(i, share, left=left, height=0.8,
                      color=COLOURS.get(name, RIGHT if name == truth else WRONG))
            if share and name in wrong:
                axes.text(left + 0.5 * share, i, _plain(name), ha="center", va="center",
                          fontsize=9, color="#ffffff")
            left += share
    axes.set_yticks(range(len(hidden)), [_plain(n) for n in hidden], fontsize=10)
    axes.set(ylim=(len(hidden) - 0.5, -0.5), xlim=(0.0, 100.0))
    axes.set_xlabel("percent of the cases", fontsize=11)
    for what, colour in (("named right", RIGHT), ("named wrongly", WRONG), *(
            (_plain(n), COLOURS[n]) for n in NOBODY)):
        axes.barh(0, 0.0, color=colour, label=what)
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=4, frameon=False, fontsize=10)
    return save_figure(figure, path)


def _plain(name: str) -> str:
    return name.replace("_", " ")


def document(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The table for a script."""
    return [{"group": r.group, "n": r.n, **r.shares, "extra": r.extra,
             "right_ci90": list(r.interval), "alone": r.alone,
             "size_off": [None if math.isnan(s) else s for s in r.sizes], "seconds": r.seconds,
             "targets": TARGETS.get(r.group, {}), "prototype": PROTOTYPE.get(r.group),
             "ok": r.ok} for r in rows]
