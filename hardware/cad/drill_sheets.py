"""Drill sheets: every cut part at full size on A4, to lay under a part or glue on a blank.

SVG in millimetres from the table of a sheet; a ruler on each says whether the printer scaled it.
"""

from __future__ import annotations

from pathlib import Path

from layout import Hole, Sheet
from outlines import Outline, sampled

PAGE = 210.0, 297.0
LEFT, TOP = 19.0, 30.0
RULER = 100.0
INK = 'fill="none" stroke="#20242a" stroke-width="0.25"'


def _loop(outline: Outline, ink: str = INK) -> str:
    """Closed curve; arcs as chords of 0.5 mm, 0.002 mm off."""
    points = " ".join(f"{x:.3f},{-y:.3f}" for x, y in sampled(outline))
    return f'<polygon points="{points}" {ink}/>'


def _hole(hole: Hole) -> str:
    r = hole.diameter / 2 + 1.5
    x, y = hole.x, -hole.y
    cross = f"M{x - r:.2f},{y:.2f}h{2 * r:.2f}M{x:.2f},{y - r:.2f}v{2 * r:.2f}"
    return (f'<circle cx="{hole.x:.3f}" cy="{-hole.y:.3f}" r="{hole.diameter / 2:.3f}" {INK}/>'
            f'<path d="{cross}" {INK.replace("0.25", "0.12")}/>')


def _sizes(sheet: Sheet) -> str:
    """How many holes of which diameter: "4 x 3.2 mm, 2 x 12 mm"."""
    sizes = sorted({round(h.diameter, 2) for h in sheet.holes})
    count = {d: sum(round(h.diameter, 2) == d for h in sheet.holes) for d in sizes}
    return ", ".join(f"{n} x {d:g}" for d, n in count.items()) + " mm"


def svg(sheet: Sheet) -> str:
    """One page. Raises ValueError where the part is larger than the paper."""
    points = sampled(sheet.outline)
    low = [min(q[k] for q in points) for k in (0, 1)]
    high = [max(q[k] for q in points) for k in (0, 1)]
    if high[0] - low[0] > PAGE[0] - 2 * LEFT + 10 or high[1] - low[1] > PAGE[1] - 2 * TOP:
        raise ValueError(f"{sheet.name}: {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} mm do "
                         "not fit on A4")
    x, y = LEFT - low[0], TOP + 12 + high[1]
    marks = "".join(_loop(m, INK.replace("#20242a", "#b3261e")) for m in sheet.marks)
    words = 'font-family="sans-serif" font-size="4" fill="#20242a"'
    ticks = "".join(f"M{LEFT + t},{TOP - 9}v{-4 if t % 50 == 0 else -2}" for t in range(0, 101, 10))
    seen = ("from behind, v up" if sheet.name == "back_plate" else
            "from above, X (forward) to the right")
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{PAGE[0]:g}mm" height="{PAGE[1]:g}mm" '
        f'viewBox="0 0 {PAGE[0]:g} {PAGE[1]:g}">',
        f'<text x="{LEFT}" y="{TOP - 21}" {words}>{sheet.name}, {sheet.thickness:g} mm, 1:1, '
        f"{seen}.</text>",
        f'<text x="{LEFT}" y="{TOP - 15}" {words}>Print at 100 %: the ruler must be {RULER:g} mm '
        "long.</text>",
        f'<path d="M{LEFT},{TOP - 9}h{RULER}{ticks}" {INK}/>',
        f'<text x="{LEFT}" y="{TOP - 2}" {words}>Holes: {_sizes(sheet)}. Red is engraved, not cut.'
        "</text>",
        f'<g transform="translate({x:.3f} {y:.3f})">',
        _loop(sheet.outline), *(_loop(c.outline) for c in sheet.cuts),
        *(_hole(h) for h in sheet.holes), marks, "</g>", "</svg>", ""])


def write(sheet: Sheet, path: Path) -> None:
    path.write_text(svg(sheet), encoding="utf-8")
