"""Diagrams as SVG: one block per cable, two devices and the wires between them, upright and
narrow, so that letters can be read on a phone and on paper.

Letters are placed by rule and not by a layout program: the same sources give the same bytes.
"""

from __future__ import annotations

import textwrap
from html import escape
from typing import Any

from harness import Chain, Row

WIDTH, MARGIN, SIDE, ROW = 360, 6, 122, 21
"""Of the drawing, its edge, a device and one wire [px]."""
PAINT = {"BK": "#1b1b1b", "BN": "#7a4a21", "BU": "#2460c8", "GN": "#1e8c3c", "OG": "#e07b1a",
         "RD": "#cc2222", "VT": "#7a2bb5", "WH": "#ffffff", "YE": "#e8c81e", "": "#9aa0a6"}
FONT = "font-family='Helvetica, Arial, DejaVu Sans, sans-serif'"


class Sheet:
    """SVG elements, and how far down they reach."""

    def __init__(self) -> None:
        self.parts: list[str] = []
        self.y = 0.0

    def text(self, x: float, y: float, words: str, size: float = 11, weight: str = "normal",
             anchor: str = "start", fill: str = "#111") -> None:
        self.parts.append(f"<text x='{x:g}' y='{y:g}' font-size='{size:g}' font-weight='{weight}' "
                          f"text-anchor='{anchor}' fill='{fill}'>{escape(words)}</text>")

    def rect(self, x: float, y: float, wide: float, high: float, fill: str = "#f5f6f7",
             stroke: str = "#444", radius: float = 3) -> None:
        self.parts.append(f"<rect x='{x:g}' y='{y:g}' width='{wide:g}' height='{high:g}' "
                          f"rx='{radius:g}' fill='{fill}' stroke='{stroke}'/>")

    def wire(self, x0: float, x1: float, y: float, colour: str, thick: float = 4) -> None:
        """A dark edge keeps white and yellow visible."""
        for paint, width in (("#333", thick + 1.6), (PAINT[colour], thick)):
            self.parts.append(f"<line x1='{x0:g}' x2='{x1:g}' y1='{y:g}' y2='{y:g}' "
                              f"stroke='{paint}' stroke-width='{width:g}'/>")

    def paragraph(self, words: str, size: float = 10.5) -> None:
        """Full width, below what is there."""
        for line in textwrap.wrap(words, int(1.9 * WIDTH / size)):
            self.y += size + 3.5
            self.text(MARGIN, self.y, line, size, fill="#333")

    def svg(self, title: str) -> str:
        high = self.y + MARGIN
        head = (f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {high:g}' "
                f"width='{WIDTH}' height='{high:g}' {FONT} role='img'>")
        back = f"<rect width='{WIDTH}' height='{high:g}' fill='#fff'/>"
        return "\n".join([head, f"<title>{escape(title)}</title>", back, *self.parts, "</svg>\n"])


def heading(sheet: Sheet, x: float, part: dict[str, Any], top: float) -> float:
    """Name, subtype and id of a device from `top` on; returns where its pins begin."""
    y = top
    for line in textwrap.wrap(str(part["type"]), 18):
        y += 13
        sheet.text(x + 5, y, line, 11, "bold")
    for line in textwrap.wrap(str(part.get("subtype", "")), 23):
        y += 11.5
        sheet.text(x + 5, y, line, 9, fill="#333")
    sheet.text(x + 5, y + 11.5, part["pn"], 8.5, fill="#666")
    return y + 17


def block(sheet: Sheet, left: dict[str, Any], right: dict[str, Any], cable: dict[str, Any],
          rows: list[Row]) -> None:
    """Two devices and the wires between them."""
    top = sheet.y + MARGIN
    far = WIDTH - MARGIN - SIDE
    place = len(sheet.parts)
    start = max(heading(sheet, MARGIN, left, top), heading(sheet, far, right, top))
    low = start + ROW * len(rows) + 3
    frames = Sheet()
    for x in (MARGIN, far):
        frames.rect(x, top, SIDE, low - top)
    sheet.parts[place:place] = frames.parts
    middle = WIDTH / 2
    about = [*textwrap.wrap(str(cable["type"]), 20), str(cable["pn"])]
    if "length" in cable:
        about[-1] += f", {1000 * cable['length']:g} mm"
    for n, line in enumerate(about):
        sheet.text(middle, start - 7 - 10.5 * (len(about) - 1 - n), line, 9, anchor="middle",
                   fill="#333" if n < len(about) - 1 else "#666")
    for n, (a, b, colour, word) in enumerate(rows):
        y = start + ROW * n + 13
        sheet.wire(MARGIN + SIDE, far, y, colour)
        if colour:
            sheet.text(middle, y - 4.5, word, 9, anchor="middle")
        sheet.text(MARGIN + SIDE - 6, y + 4, a, 11, anchor="end")
        sheet.text(far + 6, y + 4, b, 11)
    sheet.y = low


def diagram(data: dict[str, Any], chains: list[Chain], beside: dict[str, list[str]]) -> str:
    """SVG of one diagram; ``beside``: device -> what is soldered on its board."""
    sheet = Sheet()
    told: set[str] = set()
    for a, cable, b, rows in chains:
        block(sheet, data["connectors"][a], data["connectors"][b], data["cables"][cable], rows)
        for name in (a, b):
            part = data["connectors"][name]
            if name in told:
                continue
            told.add(name)
            for line in beside.get(name, ()):
                sheet.paragraph(line)
            for extra in part.get("additional_components", ()):
                where = f", {extra['subtype']}" if "subtype" in extra else ""
                sheet.paragraph(f"With it: {extra['type']}{where} ({extra['pn']}).")
            if "notes" in part:
                sheet.paragraph(f"{part['type']}: {part['notes']}.")
        sheet.y += 10
    return sheet.svg(data["metadata"]["title"])
