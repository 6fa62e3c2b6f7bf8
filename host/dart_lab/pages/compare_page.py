"""Sentences, table rows and the HTML page of ``dart-hal compare``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.car.compare import Comparison, Difference, resample_from_first_command
from dart_hal.car.table import TABLE_COLUMNS
from dart_hal.core.timing import SAMPLE
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import significant

STATISTICS = ("n", "mean", "std", "min", "max")
# Points of a curve: about the width of the picture in pixels.
MAX_CURVE_POINTS = 400
# Characters of a value in a table.
MAX_VALUE_LENGTH = 60


def lead(found: Comparison) -> str:
    """Return one sentence: whether and when the two runs begin to differ."""
    same = found.same_commands
    parted = found.parted
    if same is None:
        return "one of them was not driven, so that there is no common start to compare from"
    if same < SAMPLE:
        return "they were driven by different commands from the first one on"
    if parted is None:
        return (f"driven by the same commands for {same:.2f} s, and within that time neither "
                "speed nor yaw rate differs")
    return (f"driven by the same commands for {same:.2f} s; {parted.t:.2f} s after the first, "
            f"{parted.channel} is {significant(parted.a)} in A and {significant(parted.b)} "
            f"{TABLE_COLUMNS[parted.channel].unit} in B")


def statistic_rows(statistics: Mapping[str, Sequence[Mapping[str, float]]]) -> list[list[str]]:
    """Return a head, then two rows for each channel: A and B."""
    rows = [["channel", "", *STATISTICS]]
    for name, both in statistics.items():
        for side, one in zip("AB", both, strict=True):
            rows.append([_label(name) if side == "A" else "", side, str(one["n"]),
                         *(significant(one.get(key)) for key in STATISTICS[1:])])
    return rows


def _label(name: str) -> str:
    """Return a channel with its unit, if it has one."""
    unit = TABLE_COLUMNS[name].unit if name in TABLE_COLUMNS else ""
    return f"{name} [{unit}]" if unit else name


def difference_rows(differs: Sequence[Difference]) -> list[list[str]]:
    """Return rows of name, value in A and value in B."""
    def shorten(value: Any) -> str:
        text = "-" if value is None else str(value)
        return text if len(text) <= MAX_VALUE_LENGTH else text[:MAX_VALUE_LENGTH - 3] + "..."

    return [[d.name, shorten(d.a), shorten(d.b)] for d in differs]


def write_page(found: Comparison, path: Path, answer: dict[str, Any]) -> Path:
    """Write the page. Errors: OSError."""
    runs = [[side, str(r["path"]), r["car"], f"{r['duration_s']:.1f} s", f"{r['distance_m']:.1f} m",
             f"{r['lost']} / {r['damaged']}", r["firmware"]]
            for side, r in zip("AB", answer["runs"], strict=True)]
    head, *rows = statistic_rows(answer["statistics"])
    differ = table(("what", "A", "B"), difference_rows(found.differs))
    sentence = lead(found)
    sections = {
        "pictures": ("Side by side", _pictures(found)),
        "runs": ("The two runs", table(
            ("", "run", "car", "lasts", "drove", "lost / damaged frames", "firmware"), runs, 3)),
        "statistics": ("Statistics", table(head, rows, 2)),
        "differ": ("What differs", differ or el(
            "p", "Car, firmware and files of the car are the same.")),
        "numbers": ("All numbers", page.download(answer, "comparison.json"))}
    card = page.card(el("p", sentence[:1].upper() + sentence[1:] + ".", class_="big"),
                     good=found.parted is None and found.same_commands is not None)
    return page.write(path, page.page("comparison", "Two runs side by side", card, sections))


def _pictures(found: Comparison) -> Html:
    """Draw speed, yaw rate and commands of both over the time since the first command."""
    both = resample_from_first_command(found.a), resample_from_first_command(found.b)
    if both[0] is None or both[1] is None:
        return el("p", "One of them was not driven: there is no common beginning.")
    drawn = []
    for name in ("speed", "yaw_rate", "command_steering", "command_throttle"):
        series = []
        for drive, style in zip(both, ("before", "after"), strict=True):
            assert drive is not None
            # Every n-th sample, n rounded up, gives at most MAX_CURVE_POINTS.
            step = -(-len(drive["t"]) // MAX_CURVE_POINTS)
            t = drive["t"][::step]
            y = drive[name][::step]
            series.append(charts.Series(t, y, np.full(len(t), np.nan), style, marked=False))
        drawn.append(page.figure(name.replace("_", " "), charts.draw_lines(
            name, "time since the first command [s]", _label(name), series)))
    return join([svg.legend([("before", "A"), ("after", "B")]), page.figures(drawn)])
