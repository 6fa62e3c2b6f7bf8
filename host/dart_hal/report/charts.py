"""The chart kit: lines with whiskers, steps and bars as inline SVG, fed with plain numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.types import FloatArray

from . import svg
from .html import Html
from .numbers import significant

ROW = 17.0  # px from one bar to the next
NAMES = 145.0  # px left of the bars
STEPS_HEIGHT = 220.0  # px
MAX_LABELLED = 6
"""Steps whose figures stand beside each other without touching."""


@dataclass(frozen=True, slots=True)
class Series:
    """y over x (n,), whiskers ``reach`` to either side (NaN: none); style: before, after, car."""

    x: FloatArray
    y: FloatArray
    reach: FloatArray
    style: str = "after"
    joined: bool = True
    marked: bool = True


def lines(name: str, x_label: str, y_label: str, series: Sequence[Series],
          x_names: Sequence[str] = ()) -> Html:
    """Series in one frame with 0 in it; x_names: instead of numbers, at x = 0, 1, 2..."""
    x = ((-0.5, len(x_names) - 0.5) if x_names
         else svg.around(*(s.x for s in series), zero=False))
    ends = (s.y + side * np.nan_to_num(s.reach) for s in series for side in (-1.0, 1.0))
    frame = svg.Frame(x, svg.around(*ends))
    parts = frame.axes(x_label, y_label, x_names)
    for s in series:
        parts += svg.curve(frame, s.x, s.y, s.y - s.reach, s.y + s.reach, s.style, s.joined,
                           s.marked)
    return svg.picture(name, parts)


def steps(name: str, y_label: str, values: FloatArray, level: float, level_name: str) -> Html:
    """A value step by step from 0, and a level to compare it with (NaN: none)."""
    n, nothing = len(values), np.full(len(values), math.nan)
    frame = svg.Frame((-0.5, n - 0.5), (0.0, svg.around(values, np.array([level]))[1]),
                      height=STEPS_HEIGHT)
    parts = frame.axes("step", y_label, [str(i) for i in range(n)])
    if math.isfinite(level):
        start, end = frame.at(-0.5, level), frame.at(n - 0.5, level)
        parts += [svg.line(start, end, "ctrv"),
                  svg.text(end[0] - 4, end[1] - 5, f"{level_name} {significant(level)}", "end")]
    parts += svg.curve(frame, np.arange(n, dtype=float), values, nothing, nothing, "after")
    for i in range(n) if n <= MAX_LABELLED else (0, 1, n - 1):
        if math.isfinite(values[i]):
            px, py = frame.at(i, float(values[i]))
            parts.append(svg.text(px, py - 9, significant(float(values[i])), "middle"))
    return svg.picture(name, parts, height=STEPS_HEIGHT)


def bars(name: str, x_label: str, rows: Sequence[tuple[str, float, str]]) -> Html:
    """(name, value, style) each on a logarithmic scale from 1: below it there is no bar."""
    top = max((value for _, value, _ in rows), default=0.0)
    height = svg.TOP + ROW * len(rows) + svg.BOTTOM
    frame = svg.Frame((0.0, 1.15 * math.log10(max(top, 10.0))), (0.0, 1.0), height=height,
                      left=NAMES)
    parts = frame.x_axis(x_label, [f"{10**i:g}" for i in range(int(frame.x[1]) + 1)])
    for i, (words, value, style) in enumerate(rows):
        y, end = svg.TOP + i * ROW, frame.at(math.log10(max(value, 1.0)), 0.0)[0]
        parts += [svg.bar(frame.left, y + 2, end - frame.left, ROW - 5, style),
                  svg.text(frame.left - 6, y + 12, words, "end"),
                  svg.text(end + 5, y + 12, significant(value))]
    return svg.picture(name, parts, height=height)
