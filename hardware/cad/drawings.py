"""DXF drawings for a laser cutter or a mill, from the table of a sheet.

Millimetres ($INSUNITS 4), layers CUT and ENGRAVE, each outline one closed polyline with arcs as
bulges, each round hole a CIRCLE; no text, dimension or construction line.
"""

from __future__ import annotations

from pathlib import Path

import ezdxf
from layout import Sheet
from outlines import Outline


def write(sheet: Sheet, path: Path) -> None:
    """One drawing at full size, seen from above, in the frame of the sheet."""
    ezdxf.options.write_fixed_meta_data_for_testing = True  # no dates, no random ids
    document = ezdxf.new("R2010", units=ezdxf.units.MM)
    document.layers.add("CUT", color=1)
    document.layers.add("ENGRAVE", color=5)
    space = document.modelspace()

    def closed(outline: Outline, layer: str) -> None:
        points = [(round(x, 6), round(y, 6), b) for x, y, b in outline]
        space.add_lwpolyline(points, format="xyb", close=True, dxfattribs={"layer": layer})

    closed(sheet.outline, "CUT")
    for cut in sheet.cuts:
        closed(cut.outline, "CUT")
    for hole in sheet.holes:
        space.add_circle((hole.x, hole.y), hole.diameter / 2, dxfattribs={"layer": "CUT"})
    for mark in sheet.marks:
        closed(mark, "ENGRAVE")
    document.saveas(path)


def entities(path: Path) -> list[tuple[object, ...]]:
    """Type, layer and numbers of every entity, rounded to 1 um: what two drawings must share."""
    found = []
    for e in ezdxf.readfile(path).modelspace():
        if e.dxftype() == "CIRCLE":
            numbers = [e.dxf.center.x, e.dxf.center.y, e.dxf.radius]
        elif e.dxftype() == "LWPOLYLINE":
            numbers = [v for point in e.get_points("xyb") for v in point]
        else:
            numbers = []
        found.append((e.dxftype(), e.dxf.layer, *(round(float(v), 3) + 0.0 for v in numbers)))
    return sorted(found, key=str)
