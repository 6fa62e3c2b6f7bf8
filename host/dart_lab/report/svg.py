"""Small charts as inline SVG; colours are classes of the page, so they follow light and dark."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dart_hal.core.types import FloatArray

from .html import Html, el

WIDTH, HEIGHT = 440.0, 270.0
LEFT, RIGHT, TOP, BOTTOM = 62.0, 10.0, 12.0, 46.0
MARK = 3.5


@dataclass(frozen=True, slots=True)
class Frame:
    """Where data lie in the picture: intervals (low, high) of both axes."""

    x: tuple[float, float]
    y: tuple[float, float]
    width: float = WIDTH
    height: float = HEIGHT
    left: float = LEFT

    def at(self, x: float, y: float) -> tuple[float, float]:
        """A point of the data in the picture."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return (self.left + across * (self.width - self.left - RIGHT),
                self.height - BOTTOM - up * (self.height - TOP - BOTTOM))

    def axes(self, x_label: str, y_label: str, x_names: Sequence[str] = ()) -> list[Html]:
        """Both axes with grid, numbers and labels; x_names instead of numbers at 0, 1, 2..."""
        return [*self.y_axis(y_label), *self.x_axis(x_label, x_names)]

    def x_axis(self, words: str, names: Sequence[str] = ()) -> list[Html]:
        """The line below, with numbers or names."""
        bottom, out = self.height - BOTTOM, []
        marks = list(enumerate(names)) if names else [
            (v, label(v, self.x)) for v in ticks(*self.x, most=6)]
        for v, name in marks:
            x, _ = self.at(v, self.y[0])
            out += [line((x, bottom), (x, bottom + 4), "tick"),
                    text(x, bottom + 17, name, "middle")]
        middle = (self.left + self.width - RIGHT) / 2
        return [*out, line((self.left, bottom), (self.width - RIGHT, bottom), "tick"),
                text(middle, self.height - 8, words, "middle")]

    def y_axis(self, words: str) -> list[Html]:
        """Numbers at the left, with a line across at each."""
        out = []
        for v in ticks(*self.y):
            _, y = self.at(self.x[0], v)
            out += [line((self.left, y), (self.width - RIGHT, y), "grid" if v else "zero"),
                    text(self.left - 6, y + 4, label(v, self.y), "end")]
        half = TOP + (self.height - BOTTOM - TOP) / 2
        return [*out, el("text", words, x=13, y=_px(half), class_="t", text_anchor="middle",
                         transform=f"rotate(-90 13 {half:.1f})")]


def picture(name: str, parts: Sequence[Html], width: float = WIDTH, height: float = HEIGHT) -> Html:
    """An SVG that fills the width that it is given; name: what a screen reader says."""
    return el("svg", el("title", name), *parts, viewBox=f"0 0 {width:g} {height:g}", role="img",
              aria_label=name, style=f"max-width:{width:g}px")


def line(a: tuple[float, float], b: tuple[float, float], class_: str) -> Html:
    """A straight line between points of the picture."""
    (x1, y1), (x2, y2) = a, b
    return el("line", x1=_px(x1), y1=_px(y1), x2=_px(x2), y2=_px(y2), class_=class_)


def text(x: float, y: float, words: str, anchor: str = "start", class_: str = "t") -> Html:
    """Words at a point of the picture."""
    return el("text", words, x=_px(x), y=_px(y), class_=class_, text_anchor=anchor)


def curve(frame: Frame, x: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray,
          class_: str, joined: bool = True, marked: bool = True) -> list[Html]:
    """Points with whiskers (k,), joined by a line that ends at a point that is not finite."""
    points, lines = [], [list[str]()]
    for a, b, lo, hi in zip(x, y, low, high, strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            lines.append([])
            continue
        px, py = frame.at(float(a), float(b))
        points.append((px, py, float(a), float(lo), float(hi)))
        lines[-1].append(f"{px:.1f},{py:.1f}")
    out = [el("polyline", points=" ".join(part), class_=f"{class_} line")
           for part in lines if joined and len(part) > 1]
    for px, py, a, lo, hi in points:
        if math.isfinite(lo) and math.isfinite(hi):
            out.append(line(frame.at(a, lo), frame.at(a, hi), f"{class_} whisker"))
        if marked:
            out.append(mark(px, py, class_))
    return out


def mark(x: float, y: float, class_: str) -> Html:
    """A square for "before", a diamond for "refit", else a disc: shapes differ as colours do."""
    if class_ == "before":
        return el("rect", x=_px(x - MARK), y=_px(y - MARK), width=2 * MARK, height=2 * MARK,
                  class_=f"{class_} mark")
    if class_ == "refit":
        reach = MARK + 1.0
        corners = ((x, y - reach), (x + reach, y), (x, y + reach), (x - reach, y))
        return el("polygon", points=" ".join(f"{a:.1f},{b:.1f}" for a, b in corners),
                  class_=f"{class_} mark")
    return el("circle", cx=_px(x), cy=_px(y), r=MARK + 0.5, class_=f"{class_} mark")


def bar(x: float, y: float, width: float, height: float, class_: str) -> Html:
    """A filled rectangle."""
    return el("rect", x=_px(x), y=_px(y), width=_px(max(width, 0.0)), height=_px(height),
              class_=f"{class_} bar")


def legend(entries: Sequence[tuple[str, str]]) -> Html:
    """(class, words): what the marks of the picture above mean."""
    def entry(class_: str, words: str) -> Html:
        return el("span", el("svg", mark(7, 7, class_), viewBox="0 0 14 14", class_="key"), words)

    return el("p", *(entry(*e) for e in entries), class_="legend")


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Round numbers within an interval, at most about ``most``."""
    step = _step(low, high, most)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [i * step for i in range(first, last + 1)]


def label(value: float, interval: tuple[float, float]) -> str:
    """A tick in as many decimals as the interval needs."""
    decimals = max(0, 2 - math.floor(math.log10(interval[1] - interval[0])))
    out = f"{value:.{decimals}f}"
    out = out.rstrip("0").rstrip(".") if "." in out else out
    return "0" if out == "-0" else out


def _step(low: float, high: float, most: int) -> float:
    raw = (high - low) / most
    power = float(10.0 ** math.floor(math.log10(raw)))
    return next(s * power for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= raw * 0.999)


def around(*parts: FloatArray, zero: bool = True) -> tuple[float, float]:
    """An interval with all finite numbers of some arrays in it, and a margin; with 0 if asked."""
    values = [float(v) for part in parts for v in part if math.isfinite(v)] + [0.0] * zero
    low, high = min(values, default=0.0), max(values, default=0.0)
    margin = 0.06 * (high - low) or max(abs(high), 1.0) * 0.1
    return low - margin, high + margin


def _px(value: float) -> float:
    return round(value, 1)
