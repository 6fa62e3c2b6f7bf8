"""Charts as inline SVG: lines with whiskers, paths and bars."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray

from . import svg
from .html import Html, el
from .numbers import significant

# All lengths in px.
ROW_HEIGHT = 17.0  # from one bar to the next
NAMES_WIDTH = 145.0  # left of the bars
# Smallest and largest height of a picture of paths, without its axes.
PATH_HEIGHTS = (90.0, 300.0)
MAX_CURVE_POINTS = 400  # about the width of a picture in pixels
BAR_HEIGHT = 8.0  # of a bar in a table


@dataclass(frozen=True, slots=True)
class Series:
    """Data of one curve.

    x, y: (n,). reach: half lengths of the whiskers (n,), NaN for none. style: before, after, car.
    joined: draw the line. marked: draw the marks.
    """

    x: FloatArray
    y: FloatArray
    reach: FloatArray
    style: str = "after"
    joined: bool = True
    marked: bool = True


def draw_lines(name: str, x_label: str, y_label: str, series: Sequence[Series],
               x_names: Sequence[str] = ()) -> Html:
    """Draw series in one frame that contains y = 0; x_names: labels at x = 0, 1, 2, ..."""
    x = ((-0.5, len(x_names) - 0.5) if x_names
         else svg.enclosing_interval(*(s.x for s in series), zero=False))
    ends = (s.y + side * np.nan_to_num(s.reach) for s in series for side in (-1.0, 1.0))
    frame = svg.ChartFrame(x, svg.enclosing_interval(*ends))
    parts = frame.axes(x_label, y_label, x_names)
    for s in series:
        parts += svg.curve(frame, s.x, s.y, s.y - s.reach, s.y + s.reach, s.style, s.joined,
                           s.marked)
    return svg.picture(name, parts)


def draw_bars(name: str, x_label: str, rows: Sequence[tuple[str, float, str]]) -> Html:
    """Draw rows (name, value, style) on a logarithmic scale from 1; smaller values have no bar."""
    top = max((value for _, value, _ in rows), default=0.0)
    height = svg.TOP_MARGIN + ROW_HEIGHT * len(rows) + svg.BOTTOM_MARGIN
    frame = svg.ChartFrame((0.0, 1.15 * math.log10(max(top, 10.0))), (0.0, 1.0), height=height,
                      left=NAMES_WIDTH)
    parts = frame.x_axis(x_label, [f"{10**i:g}" for i in range(int(frame.x[1]) + 1)])
    for i, (words, value, style) in enumerate(rows):
        y = svg.TOP_MARGIN + i * ROW_HEIGHT
        end = frame.to_pixels(math.log10(max(value, 1.0)), 0.0)[0]
        parts += [svg.bar(frame.left, y + 2, end - frame.left, ROW_HEIGHT - 5, style),
                  svg.text(frame.left - 6, y + 12, words, "end"),
                  svg.text(end + 5, y + 12, significant(value))]
    return svg.picture(name, parts, height=height)


@dataclass(frozen=True, slots=True)
class IntervalRow:
    """One value with the half-width of its interval; before: an earlier value, NaN for none."""

    name: str
    value: float
    half: float
    before: float
    words: str


def draw_intervals(name: str, x_label: str, rows: Sequence[IntervalRow]) -> Html:
    """Draw values of any units with their intervals, one row each.

    Each row is divided by the far end of its interval, so that a width is relative to its value.
    """
    # The name and the number are in a line of text above the bar: a phone has no margin for them.
    row_height = 2.0 * ROW_HEIGHT
    height = svg.TOP_MARGIN + row_height * len(rows) + svg.BOTTOM_MARGIN
    scales = [abs(row.value) + row.half or 1.0 for row in rows]
    low = min((row.value - row.half) / scale for row, scale in zip(rows, scales, strict=True))
    frame = svg.ChartFrame((min(1.1 * low, 0.0), 1.06), (0.0, 1.0), height=height, left=10.0)
    parts = frame.x_axis(x_label)
    for i, (row, scale) in enumerate(zip(rows, scales, strict=True)):
        y = svg.TOP_MARGIN + i * row_height + 24.0

        def to_x(value: float, scale: float = scale) -> float:
            return frame.to_pixels(value / scale, 0.0)[0]

        parts += [svg.text(frame.left, y - 10, row.name),
                  svg.text(frame.width - svg.RIGHT_MARGIN, y - 10, row.words, "end"),
                  svg.line((frame.left, y), (frame.width - svg.RIGHT_MARGIN, y), "grid"),
                  svg.line((to_x(row.value - row.half), y), (to_x(row.value + row.half), y),
                           "after line")]
        # An earlier value beyond the axis is only in the table.
        if frame.x[0] <= row.before / scale <= frame.x[1]:
            parts.append(svg.mark(to_x(row.before), y, "before"))
        parts.append(svg.mark(to_x(row.value), y, "after"))
    return svg.picture(name, parts, height=height)


def draw_paths(name: str, x_label: str, y_label: str, lines: Sequence[tuple[FloatArray, str]],
               mark_spacing: int) -> Html:
    """Draw paths (2, n), each with its style, on equal axes.

    Every ``mark_spacing`` points a line has a mark, so that equal times can be compared. Points
    are drawn up to twice the largest distance that the first line reaches from its first point.
    """
    # 1. Drop points further from the start than twice the reach of the reference: a prediction
    # that diverges would shrink the rest to a dot.
    reference = lines[0][0]
    reach = 2.0 * float(np.max(np.hypot(*(reference - reference[:, :1]))))
    near = [(np.where(np.hypot(*(xy - reference[:, :1])) <= reach, xy, np.nan), style)
            for xy, style in lines]
    x, y = (svg.enclosing_interval(*(xy[i] for xy, _ in near), zero=False) for i in range(2))
    # 2. One scale [px/m] for both axes. It fills the width, unless the picture gets too high.
    width = svg.PICTURE_WIDTH - svg.LEFT_MARGIN - svg.RIGHT_MARGIN
    scale = min(width / (x[1] - x[0]), PATH_HEIGHTS[1] / (y[1] - y[0]))
    height = max(scale * (y[1] - y[0]), PATH_HEIGHTS[0])
    frame = svg.ChartFrame(_widen(x, width / scale), _widen(y, height / scale),
                      height=height + svg.TOP_MARGIN + svg.BOTTOM_MARGIN)
    parts = frame.axes(x_label, y_label)
    # 3. Draw the lines, then the marks.
    for xy, style in near:
        nothing = np.full(xy.shape[1], math.nan)
        parts += svg.curve(frame, xy[0], xy[1], nothing, nothing, f"{style} path", marked=False)
    for xy, style in [*near[1:], near[0]]:  # the marks of the reference on top
        for a, b in xy[:, mark_spacing::mark_spacing].T:
            if math.isfinite(a):
                parts.append(svg.mark(*frame.to_pixels(float(a), float(b)), style))
    return svg.picture(name, parts, height=frame.height)


def _widen(interval: tuple[float, float], length: float) -> tuple[float, float]:
    """Extend an interval to a length, around the same middle."""
    middle = 0.5 * (interval[0] + interval[1])
    return middle - 0.5 * length, middle + 0.5 * length


@dataclass(frozen=True, slots=True)
class BarRow:
    """A row of ``tabulate_bars``.

    values: by column, NaN for none. medians: by column, each drawn as a tick; NaN for none.
    """

    name: str
    style: str
    values: Sequence[float]
    medians: Sequence[float] = ()


def tabulate_bars(caption: str, columns: Sequence[str], rows: Sequence[BarRow]) -> Html:
    """Return a table of numbers with a bar below each; every column has its own scale.

    The table fits a phone: its columns shrink, and no number is cut. Infinity is written as
    "diverged", a missing value as "-".
    """
    # The largest finite value or median of a column takes the full width.
    tops = [max((v for row in rows for v in (*row.values[i:i + 1], *row.medians[i:i + 1])
                 if math.isfinite(v)), default=0.0) for i in range(len(columns))]
    head = el("tr", el("th"), *(el("th", words) for words in columns))
    body = [el("tr", el("th", row.name, scope="row"), *(
        _bar_cell(row.values[i], row.medians[i] if row.medians else math.nan, top, row.style)
        for i, top in enumerate(tops))) for row in rows]
    return el("table", el("caption", caption), el("thead", head), el("tbody", *body),
              class_="bars")


def _bar_cell(value: float, median: float, top: float, style: str) -> Html:
    """Return one number with its bar, and a tick at the median."""
    number = "diverged" if math.isinf(value) else significant(value)
    # A value without a finite size has no bar.
    if not (math.isfinite(value) and top > 0.0):
        return el("td", number)
    parts = [svg.bar(0.0, 1.0, 100.0 * value / top, BAR_HEIGHT - 2.0, style)]
    if math.isfinite(median):
        x = 100.0 * median / top
        parts.append(svg.line((x, 0.0), (x, BAR_HEIGHT), "median"))
    return el("td", number, el("svg", *parts, viewBox=f"0 0 100 {BAR_HEIGHT:g}",
                               preserveAspectRatio="none", aria_hidden="true"))
