"""Plan view of the base plate with the cables on it, at true scale."""

from __future__ import annotations

import textwrap
from math import dist
from pathlib import Path

from drawing import PAINT
from harness import HERE, WiringError
from routing import (
    LEVEL,
    SHOWN,
    Parameters,
    Route,
    cad,
    computed,
    faults,
    known_parameters,
    routes,
    sampled,
)

BESIDE = 2.2
"""mm between leads of a bundle, in the picture alone."""
EXPLAINED = (
    "Full: above the base plate; dashed, and white squares: below. Lengths along the route, "
    "heights included, without play for plugs and ties. Connectors of the kit by its photographs: "
    "within 10 mm [assumed].")
WHOLE, DETAIL = (80.0, 184.0, 160.0, -45.0), (24.0, 108.0, 112.0, 0.0)
"""y of the left edge, x of the upper one, width, x of the lower edge of a picture [mm]."""


def drawing(diagram: str, folder: Path = HERE, p: Parameters | None = None) -> str:
    """SVG of the cables that one diagram adds, 1 unit = 1 mm, forward up.

    Raises WiringError for a route with a fault.
    """
    p = p or known_parameters()
    if wrong := faults(folder, p):
        raise WiringError("\n".join(wrong))
    picture = Plan(p, *(WHOLE if diagram == SHOWN[0] else DETAIL))
    picture.plate()
    picture.places()
    shown = [route for route in routes(folder, p) if route.diagram == diagram]
    bundle = diagram != SHOWN[0]  # leads that run side by side
    for number, route in enumerate(shown, 1):
        picture.cable(number, route, BESIDE * (number - (len(shown) + 1) / 2) if bundle else 0.0)
    return picture.svg(shown)


class Plan:
    """The plate seen from above; x of the car points up in the picture, y to the left."""

    def __init__(self, p: Parameters, left: float, top: float, width: float, low: float) -> None:
        self.p, self.parts, self.left, self.top, self.width = p, list[str](), left, top, width
        self.end = top - low
        """Lower edge of the picture, from its upper one [mm]."""

    def at(self, x: float, y: float) -> tuple[float, float]:
        return self.left - y, self.top - x

    def closed(self, corners: list[tuple[float, float]], fill: str, stroke: str = "#777") -> None:
        points = " ".join("{:.1f},{:.1f}".format(*self.at(x, y)) for x, y in corners)
        self.parts.append(f"<polygon points='{points}' fill='{fill}' stroke='{stroke}' "
                          "stroke-width='.4'/>")

    def text(self, x: float, y: float, words: str, size: float = 3.4,
             anchor: str = "middle", fill: str = "#333") -> None:
        self.parts.append(f"<text x='{x:.1f}' y='{y:.1f}' font-size='{size:g}' fill='{fill}' "
                          f"text-anchor='{anchor}'>{words}</text>")

    def plate(self) -> None:
        """Outline, openings, screw holes, the lidar's rotor, a scale."""
        sheet = cad.base_plate(self.p)
        self.closed(sampled(sheet.outline), "#eef2f5")
        for cut in sheet.cuts:
            self.closed(sampled(cut.outline), "#fff")
        for hole in sheet.holes:
            x, y = self.at(hole.x, hole.y)
            self.parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='{hole.diameter / 2:.2f}' "
                              "fill='#fff' stroke='#777' stroke-width='.3'/>")
        x, y = self.at(self.p.lidar.axis_x, 0)
        self.parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='35' fill='none' stroke='#999' "
                          "stroke-width='.4' stroke-dasharray='1 1'/>")
        self.text(x, y + 1, "lidar")
        x, y = 10.0, self.end + 7
        self.parts.append(f"<path d='M{x:.1f} {y - 1:.1f} v2 M{x:.1f} {y:.1f} h50 m0 -1 v2' "
                          "stroke='#333' stroke-width='.5' fill='none'/>")
        self.text(x + 25, y - 1.2, "50 mm")
        self.parts.append(f"<rect width='{self.width:g}' height='9' fill='#fff'/>")
        self.text(self.width / 2, 6, "Cables from above, forward is up", 5, fill="#111")

    def places(self) -> None:
        """What the cables lead to, by name."""
        for name, xyz in computed(self.p).items():
            x, y = self.at(xyz[0], xyz[1])
            below = xyz[2] < LEVEL and not name.startswith("@nano")
            self.parts.append(f"<rect x='{x - 2:.1f}' y='{y - 2:.1f}' width='4' height='4' "
                              f"fill='{'#fff' if below else '#333'}' stroke='#333' "
                              "stroke-width='.5'/>")
            if not name.startswith("@nano "):
                self.text(x, y - 2.8, name.removeprefix("@"), 3.2)
        nano = sum(self.p.base_windows.nano_x) / 2, sum(self.p.base_windows.nano_y) / 2
        half = self.p.imu_nano.nano_length / 2, self.p.imu_nano.nano_width / 2
        self.closed([(nano[0] + i * half[0], nano[1] + j * half[1])
                     for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))], "#9ec1e855")
        self.text(*self.at(nano[0] - 16, nano[1]), "Nano", 3.2)

    def cable(self, number: int, route: Route, aside: float) -> None:
        """Full above the plate, dashed below; its number in the middle of its longest stretch."""
        for a, b in zip(route.points, route.points[1:], strict=False):
            (x0, y0), (x1, y1) = (self.at(x + aside, y + aside) for x, y, _ in (a, b))
            dash = "" if min(a[2], b[2]) > LEVEL else " stroke-dasharray='2.4 1.4'"
            for paint, wide in (("#333", 1.7), (PAINT[route.colour], 1.1)):
                self.parts.append(f"<line x1='{x0:.1f}' y1='{y0:.1f}' x2='{x1:.1f}' y2='{y1:.1f}' "
                                  f"stroke='{paint}' stroke-width='{wide}'{dash}/>")
        a, b = max(zip(route.points, route.points[1:], strict=False),
                   key=lambda ends: dist(ends[0][:2], ends[1][:2]))
        share = 0.5 if not aside else 0.52 + 0.21 * aside / BESIDE
        share = 1 - share if a[2] > b[2] else share  # the way back
        x, y = self.at(*(aside + u + (v - u) * share for u, v in zip(a[:2], b[:2], strict=True)))
        self.parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='2.6' fill='#fff' stroke='#333' "
                          "stroke-width='.4'/>")
        self.text(x, y + 1.3, str(number), 3.6, fill="#111")

    def svg(self, every: list[Route]) -> str:
        """With the list of cables below."""
        y = self.end + 14
        columns = 2 if self.width > 150 else 1  # so that the whole fits on a sheet of A4
        rows = -(-len(every) // columns)
        wide = self.width / columns
        for number, r in enumerate(every, 1):
            column, row = divmod(number - 1, rows)
            left, has = column * wide, f"of {r.limit:.0f} mm" if r.limit else "mm"
            self.text(left + 4, y + 5 * row, f"{number}  {r.ends}", 3.3, "start", "#111")
            self.text(left + wide - 5, y + 5 * row, f"{r.length:.0f} {has}", 3.3, "end")
        y += 5 * (rows - 1) + 1
        for words in textwrap.wrap(EXPLAINED, int(self.width / 1.7)):
            y += 4
            self.text(4, y, words, 3, "start")
        head = (f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {self.width:g} {y + 4:.0f}' "
                f"width='{self.width:g}mm' height='{y + 4:.0f}mm' font-family='Helvetica, Arial, "
                "DejaVu Sans, sans-serif' role='img'>")
        return "\n".join([head, "<title>Cable routing</title>",
                          "<rect width='100%' height='100%' fill='#fff'/>", *self.parts,
                          "</svg>\n"])
