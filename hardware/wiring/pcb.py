"""The board of the multiplexer as a printed circuit: mux_board.yml once more, for a board house.

One copper layer, on the solder side, for the bare wires of the perforated board cross nowhere. The
files are Gerber X2 and Excellon; a test reads them back and compares what their copper joins.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

from circuit import names
from drawing import FONT
from gerber_writer import Circle, DataLayer
from gerber_writer import Path as Outline
from harness import HERE
from perfboard import layout, socket

PITCH = 2.54
PAD, LEG, WIRE = 1.9, 0.8, 1.0
"""mm: copper around a hole; hole of a leg, hole of a wire of 0.25 mm2."""
TRACK, MASK = 0.8, 0.1
"""mm: width of a track; how far the solder mask stays off a pad."""
DATE = re.compile(r"G04 #@! TF\.CreationDate,.*\n")
"""Line that would differ at each run."""


def place(data: dict[str, Any], hole: str) -> tuple[float, float]:
    """x, y of a hole [mm] from the lower left corner of the board, seen from above."""
    (wide, high), (last, columns) = data["board"], data["size"]
    rows = ord(last) - ord("A")
    return (round(wide / 2 + PITCH * (int(hole[1:]) - 1 - (columns - 1) / 2), 3),
            round(high / 2 + PITCH * (rows / 2 - (ord(hole[0]) - ord("A"))), 3))


def drills(data: dict[str, Any], folder: Path = HERE) -> dict[str, float]:
    """Hole -> its diameter [mm], of all that something is soldered into."""
    legs = [*socket(data, len(names(data["device"], folder))).values(),
            *(hole for pairs in data["parts"].values() for ends in pairs for hole in ends)]
    return dict.fromkeys(legs, LEG) | dict.fromkeys(data["leads"], WIRE)


def files(folder: Path = HERE) -> dict[str, str]:
    """File name -> text. Raises WiringError."""
    data = layout(folder)
    holes = drills(data, folder)
    copper, mask = DataLayer("Copper,L1,Bot,Signal"), DataLayer("Soldermask,Bot", negative=True)
    for hole in holes:
        copper.add_pad(Circle(PAD, "ComponentPad"), place(data, hole))
        mask.add_pad(Circle(PAD + 2 * MASK, "Material"), place(data, hole))
    for a, b in data["wires"]:
        copper.add_trace_line(place(data, a), place(data, b), TRACK, "Conductor")
    return {"mux_board-B_Cu.gbr": _text(copper), "mux_board-B_Mask.gbr": _text(mask),
            "mux_board-F_Silkscreen.gbr": _text(_legend(data, folder)),
            "mux_board-Edge_Cuts.gbr": _text(_outline(data)),
            "mux_board.drl": _excellon(data, holes)}


def _legend(data: dict[str, Any], folder: Path) -> DataLayer:
    """Body of the chip with its notch, a stroke for each part, a dot at pin 1."""
    legend = DataLayer("Legend,Top")
    at = socket(data, len(names(data["device"], folder)))
    (x0, y0), (x1, y1) = place(data, at["1"]), place(data, at["9"])
    x0, x1, y0, y1 = x0 - 1.3, x1 + 1.3, y0 + 1.3, y1 - 1.3
    middle = (y0 + y1) / 2
    corners = [(x0, middle - 1), (x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, middle + 1),
               (x0 + 1, middle + 1), (x0 + 1, middle - 1), (x0, middle - 1)]
    for a, b in pairwise(corners):
        legend.add_trace_line(a, b, 0.2, "Other,legend")
    legend.add_pad(Circle(0.8, "Other,legend"), (x0 - 0.9, place(data, at["1"])[1]))
    for pairs in data["parts"].values():
        for a, b in pairs:
            legend.add_trace_line(place(data, a), place(data, b), 0.3, "Other,legend")
    return legend


def _outline(data: dict[str, Any]) -> DataLayer:
    wide, high = data["board"]
    edge = Outline()
    edge.moveto((0, 0))
    for corner in ((wide, 0), (wide, high), (0, high), (0, 0)):
        edge.lineto(corner)
    layer = DataLayer("Profile,NP")
    layer.add_traces_path(edge, 0.1, "Profile")
    return layer


def picture(folder: Path = HERE) -> str:
    """SVG of the solder side as seen through the board from above, ten units to a millimetre."""
    data = layout(folder)
    (wide, high), holes = data["board"], drills(data, folder)

    def at(hole: str) -> tuple[float, float]:
        x, y = place(data, hole)
        return 10 * x, 10 * (high - y)

    parts = [f"<rect width='{10 * wide}' height='{10 * high}' rx='6' fill='#2c6e49'/>"]
    for a, b in data["wires"]:
        (x0, y0), (x1, y1) = at(a), at(b)
        parts.append(f"<path d='M{x0:g} {y0:g} L{x1:g} {y1:g}' stroke='#8fc7a3' "
                     f"stroke-width='{10 * TRACK:g}' stroke-linecap='round'/>")
    for hole, size in holes.items():
        x, y = at(hole)
        parts += [f"<circle cx='{x:g}' cy='{y:g}' r='{5 * PAD:g}' fill='#e3c878'/>",
                  f"<circle cx='{x:g}' cy='{y:g}' r='{5 * size:g}' fill='#fff'/>"]
    for pin, hole in socket(data, len(names(data["device"], folder))).items():
        x, y = at(hole)
        across, down = (0, -13) if y < 5 * high else (-14, 3)
        parts.append(f"<text x='{x + across:g}' y='{y + down:g}' font-size='8' fill='#fff' "
                     f"text-anchor='middle'>{pin}</text>")
    return "\n".join([f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {10 * wide} "
                      f"{10 * high}' width='{10 * wide}' height='{10 * high}' {FONT} role='img'>",
                      "<title>Printed circuit of the multiplexer</title>", *parts, "</svg>\n"])


def _text(layer: DataLayer) -> str:
    return DATE.sub("", layer.dumps_gerber()).rstrip() + "\n"


def _excellon(data: dict[str, Any], holes: dict[str, float]) -> str:
    tools = sorted(set(holes.values()))
    lines = ["M48", "METRIC,TZ", *(f"T{n}C{size:.3f}" for n, size in enumerate(tools, 1)), "%",
             "G90", "G05"]
    for n, size in enumerate(tools, 1):
        lines.append(f"T{n}")
        lines += ["X{:.3f}Y{:.3f}".format(*place(data, hole))
                  for hole, its in holes.items() if its == size]
    return "\n".join([*lines, "T0", "M30", ""])
