"""Small charts as inline SVG; colours are classes of the page, so they follow light and dark."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dart_hal.core.types import FloatArray

from .html import Html, el

# Sizes in px. The margins have room for numbers and labels.
PICTURE_WIDTH = 440.0
PICTURE_HEIGHT = 270.0
LEFT_MARGIN = 62.0
RIGHT_MARGIN = 10.0
TOP_MARGIN = 12.0
BOTTOM_MARGIN = 46.0
MARK_RADIUS = 3.5


@dataclass(frozen=True, slots=True)
class ChartFrame:
    """Map from data to pixels: intervals (low, high) of both axes, size and left margin [px]."""

    x: tuple[float, float]
    y: tuple[float, float]
    width: float = PICTURE_WIDTH
    height: float = PICTURE_HEIGHT
    left: float = LEFT_MARGIN

    def to_pixels(self, x: float, y: float) -> tuple[float, float]:
        """Return the pixel coordinates of a point; the y axis of the picture points down."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return (self.left + across * (self.width - self.left - RIGHT_MARGIN),
                self.height - BOTTOM_MARGIN - up * (self.height - TOP_MARGIN - BOTTOM_MARGIN))

    def axes(self, x_label: str, y_label: str, x_names: Sequence[str] = ()) -> list[Html]:
        """Draw both axes with grid, numbers and labels; x_names: labels at x = 0, 1, 2, ..."""
        return [*self.y_axis(y_label), *self.x_axis(x_label, x_names)]

    def x_axis(self, words: str, names: Sequence[str] = ()) -> list[Html]:
        """Draw the x axis with numbers or names."""
        bottom = self.height - BOTTOM_MARGIN
        out = []
        marks = list(enumerate(names)) if names else [
            (v, label(v, self.x)) for v in ticks(*self.x, most=6)]
        for v, name in marks:
            x, _ = self.to_pixels(v, self.y[0])
            out += [line((x, bottom), (x, bottom + 4), "tick"),
                    text(x, bottom + 17, name, "middle")]
        middle = (self.left + self.width - RIGHT_MARGIN) / 2
        return [*out, line((self.left, bottom), (self.width - RIGHT_MARGIN, bottom), "tick"),
                text(middle, self.height - 8, words, "middle")]

    def y_axis(self, words: str) -> list[Html]:
        """Draw the numbers of the y axis, each with a grid line."""
        out = []
        for v in ticks(*self.y):
            _, y = self.to_pixels(self.x[0], v)
            out += [line((self.left, y), (self.width - RIGHT_MARGIN, y), "grid" if v else "zero"),
                    text(self.left - 6, y + 4, label(v, self.y), "end")]
        half = TOP_MARGIN + (self.height - BOTTOM_MARGIN - TOP_MARGIN) / 2
        return [*out, el("text", words, x=13, y=_px(half), class_="t", text_anchor="middle",
                         transform=f"rotate(-90 13 {half:.1f})")]


def picture(name: str, parts: Sequence[Html], width: float = PICTURE_WIDTH,
            height: float = PICTURE_HEIGHT) -> Html:
    """Return an SVG that fills the available width; name: text for screen readers."""
    return el("svg", el("title", name), *parts, viewBox=f"0 0 {width:g} {height:g}", role="img",
              aria_label=name, style=f"max-width:{width:g}px")


def line(a: tuple[float, float], b: tuple[float, float], class_: str) -> Html:
    """Draw a straight line between two points [px]."""
    return el("line", x1=_px(a[0]), y1=_px(a[1]), x2=_px(b[0]), y2=_px(b[1]), class_=class_)


def text(x: float, y: float, words: str, anchor: str = "start", class_: str = "t") -> Html:
    """Draw a text at a point [px]."""
    return el("text", words, x=_px(x), y=_px(y), class_=class_, text_anchor=anchor)


def curve(frame: ChartFrame, x: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray,
          class_: str, joined: bool = True, marked: bool = True) -> list[Html]:
    """Draw points with whiskers (k,) and a line that is interrupted at points that are not finite.
    """
    points = []
    lines = [list[str]()]
    for a, b, lo, hi in zip(x, y, low, high, strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            lines.append([])
            continue
        px, py = frame.to_pixels(float(a), float(b))
        points.append((px, py, float(a), float(lo), float(hi)))
        lines[-1].append(f"{px:.1f},{py:.1f}")
    out = [el("polyline", points=" ".join(part), class_=f"{class_} line")
           for part in lines if joined and len(part) > 1]
    for px, py, a, lo, hi in points:
        if math.isfinite(lo) and math.isfinite(hi):
            out.append(line(frame.to_pixels(a, lo), frame.to_pixels(a, hi), f"{class_} whisker"))
        if marked:
            out.append(mark(px, py, class_))
    return out


def mark(x: float, y: float, class_: str) -> Html:
    """Draw a mark: a square for "before", a diamond for "refit", else a disc."""
    if class_ == "before":
        return el("rect", x=_px(x - MARK_RADIUS), y=_px(y - MARK_RADIUS), width=2 * MARK_RADIUS,
                  height=2 * MARK_RADIUS, class_=f"{class_} mark")
    if class_ == "refit":
        radius = MARK_RADIUS + 1.0
        corners = ((x, y - radius), (x + radius, y), (x, y + radius), (x - radius, y))
        return el("polygon", points=" ".join(f"{a:.1f},{b:.1f}" for a, b in corners),
                  class_=f"{class_} mark")
    return el("circle", cx=_px(x), cy=_px(y), r=MARK_RADIUS + 0.5, class_=f"{class_} mark")


def bar(x: float, y: float, width: float, height: float, class_: str) -> Html:
    """Draw a filled rectangle."""
    return el("rect", x=_px(x), y=_px(y), width=_px(max(width, 0.0)), height=_px(height),
              class_=f"{class_} bar")


def legend(entries: Sequence[tuple[str, str]]) -> Html:
    """Return the legend of a picture: entries (class of the mark, text)."""
    def entry(class_: str, words: str) -> Html:
        return el("span", el("svg", mark(7, 7, class_), viewBox="0 0 14 14", class_="key"), words)

    return el("p", *(entry(*e) for e in entries), class_="legend")


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Return round numbers within an interval, at most about ``most``."""
    step = _tick_step(low, high, most)
    # The tolerance keeps a tick that is on an end of the interval.
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [i * step for i in range(first, last + 1)]


def label(value: float, interval: tuple[float, float]) -> str:
    """Format a tick with as many decimals as the interval needs."""
    decimals = max(0, 2 - math.floor(math.log10(interval[1] - interval[0])))
    out = f"{value:.{decimals}f}"
    out = out.rstrip("0").rstrip(".") if "." in out else out
    return "0" if out == "-0" else out


def _tick_step(low: float, high: float, most: int) -> float:
    """Return the smallest step 1, 2, 2.5 or 5 times a power of ten with at most ``most`` ticks."""
    raw = (high - low) / most
    power = float(10.0 ** math.floor(math.log10(raw)))
    return next(s * power for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= raw * 0.999)


def enclosing_interval(*parts: FloatArray, zero: bool = True) -> tuple[float, float]:
    """Return an interval around all finite numbers of arrays, with a margin; zero: include 0."""
    values = [float(v) for part in parts for v in part if math.isfinite(v)] + [0.0] * zero
    low = min(values, default=0.0)
    high = max(values, default=0.0)
    margin = 0.06 * (high - low) or max(abs(high), 1.0) * 0.1
    return low - margin, high + margin


def _px(value: float) -> float:
    return round(value, 1)
