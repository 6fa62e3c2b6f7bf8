"""Committed drawings: clean for a cutter, with the holes of the car in the deck frame."""

from __future__ import annotations

import importlib
import json
import math
import sys

import ezdxf
import numpy as np
import pytest
from ezdxf.document import Drawing

from tests.common import HARDWARE

sys.path.append(str(HARDWARE / "cad"))
drawings, layout, parameters, outlines = (importlib.import_module(n) for n in (
    "drawings", "layout", "parameters", "outlines"))
P = parameters.read()
DRAWN_PARTS = ("base_plate", "upper_plate", "back_plate", "striped_ring")
BUILT = json.loads((HARDWARE / "cad" / "built.json").read_text(encoding="utf-8"))

# The car itself, not the parameter file: X forward, Y left from the rear edge, mm; back plate:
# u, v. Jetson, posts of the expansion board, lidar, brackets, antennas, clearances, cables.
HOLES = {
    "base_plate": [(35, 43.3), (35, -42.7), (92.6, 43.3), (92.6, -42.7),
                   (37, 22.25), (37, -35.35), (123, 22.25), (123, -35.35),
                   (168.6, 25), (168.6, -25), (111.6, 31), (111.6, -31), (10, 60), (10, -60),
                   (9.5, 36.15), (9.5, -35.55), (128, 27.75), (128, -27.85), (5.5, 9), (5.5, -9),
                   (50, -25), (50, 1), (50, -39.5), (48, 44),
                   (26.205, 7.62), (26.205, -7.62), (47.795, 7.62), (47.795, -7.62)],
    "upper_plate": [(35, 43.3), (35, -42.7), (92.6, 43.3), (92.6, -42.7), (8, 60), (8, -60),
                    (110, 8), (110, -8), (9.5, 35.85), (9.5, -35.85)],
    "back_plate": [(60, 13), (-60, 13), (60, 51), (-60, 51)],
}
BOXES = {"base_plate": (0, -70, 172, 70), "upper_plate": (0, -70, 147, 70),
         "back_plate": (-70, 0, 70, 138)}


def drawing(name: str) -> Drawing:
    return ezdxf.readfile(HARDWARE / "dxf" / f"{name}.dxf")


def dirt(document: Drawing) -> list[str]:
    """What a cutter would stumble over."""
    found = []
    if document.header.get("$INSUNITS") != 4:
        found.append("not millimetres")
    for e in document.modelspace():
        if e.dxftype() not in ("LWPOLYLINE", "CIRCLE"):
            found.append(f"a {e.dxftype()}")
        elif e.dxf.layer not in ("CUT", "ENGRAVE"):
            found.append(f"layer {e.dxf.layer}")
        elif e.dxftype() == "LWPOLYLINE" and not e.closed:
            found.append("an open outline")
    return found


def circles(document: Drawing) -> np.ndarray:
    """Centres and diameters, shape (n, 3), mm."""
    return np.array([(e.dxf.center.x, e.dxf.center.y, 2 * e.dxf.radius)
                     for e in document.modelspace() if e.dxftype() == "CIRCLE"])


def missing(holes: np.ndarray, expected: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Places of the car at which the drawing has no hole within 0.05 mm."""
    return [q for q in expected if np.hypot(*(holes[:, :2] - q).T).min() > 0.05]


def outer(document: Drawing) -> list[tuple[float, float, float]]:
    """Outline of the part: the longest closed polyline on CUT."""
    loops = [tuple(e.get_points("xyb")) for e in document.modelspace()
             if e.dxftype() == "LWPOLYLINE" and e.dxf.layer == "CUT"]
    return max(loops, key=lambda loop: np.ptp([x for x, _, _ in loop]))


@pytest.mark.parametrize("name", DRAWN_PARTS)
def test_drawings_are_clean(name):
    assert dirt(drawing(name)) == []


def test_dirt_is_found():
    """Controls: a text layer, an open line, a construction line, inches."""
    document = drawing("striped_ring")
    document.modelspace().add_text("For instructional use", dxfattribs={"layer": "NOTES"})
    document.modelspace().add_lwpolyline([(0, 0), (1, 1)], dxfattribs={"layer": "CUT"})
    document.modelspace().add_line((0, 0), (30, 0), dxfattribs={"layer": "CUT"})
    document.modelspace().add_circle((0, 0), 3, dxfattribs={"layer": "CONSTRUCTION"})
    document.header["$INSUNITS"] = 1
    assert dirt(document) == ["not millimetres", "a TEXT", "an open outline", "a LINE",
                              "layer CONSTRUCTION"]


@pytest.mark.parametrize("name", sorted(HOLES))
def test_holes_are_where_the_car_requires_them(name):
    assert missing(circles(drawing(name)), HOLES[name]) == []


def test_a_moved_hole_and_a_flipped_plate_are_found():
    holes = circles(drawing("base_plate"))
    flipped = holes * [1, -1, 1]
    assert (35, 43.3) in missing(flipped, HOLES["base_plate"])
    moved = holes.copy()
    index = int(np.hypot(*(holes[:, :2] - (10, 60)).T).argmin())
    moved[index, 0] += 0.2
    assert missing(moved, HOLES["base_plate"]) == [(10, 60)]


@pytest.mark.parametrize("name", sorted(BOXES))
def test_outlines_have_the_size_of_the_car(name):
    points = np.array(outlines.sampled(outer(drawing(name)), 0.1))
    box = (*points.min(axis=0), *points.max(axis=0))
    assert box == pytest.approx(BOXES[name], abs=0.01)


def test_the_front_arc_clears_the_motor_of_the_lidar():
    """Radius 22.5 about (182, 0), cut into the plate."""
    points = outlines.sampled(outer(drawing("base_plate")), 0.2)
    distance = [math.dist(q, (182, 0)) for q in points]
    assert min(distance) == pytest.approx(22.5, abs=0.01)
    assert min(x for x, y in points if abs(y) < 1 and x > 100) == pytest.approx(159.5, abs=0.05)


@pytest.mark.parametrize("name", DRAWN_PARTS)
def test_drawing_and_mesh_have_the_same_holes(name):
    in_drawing = {tuple(np.round(c, 2)) for c in circles(drawing(name))}
    in_table = {(round(h["at"][0], 2), round(h["at"][1], 2), round(h["diameter"], 2))
                for h in BUILT["parts"][name]["holes"]}
    assert {tuple(float(v) + 0.0 for v in c) for c in in_drawing} == in_table


@pytest.mark.parametrize("name", DRAWN_PARTS)
def test_drawings_match_the_parameters(name, tmp_path):
    """The committed file is the one that its source draws."""
    sheet = next(s for s in layout.sheets(P) if s.name == name)
    drawings.write(sheet, tmp_path / "again.dxf")
    committed = HARDWARE / "dxf" / f"{name}.dxf"
    assert drawings.entities(committed) == drawings.entities(tmp_path / "again.dxf")


def test_deck_plates_carry_a_mark_that_points_forward():
    for name in ("base_plate", "upper_plate"):
        marks = [np.array(e.get_points("xy")) for e in drawing(name).modelspace()
                 if e.dxf.layer == "ENGRAVE"]
        assert len(marks) == 1
        tip = marks[0][marks[0][:, 0].argmax()]
        assert tip[1] == pytest.approx(marks[0][:, 1].mean(), abs=0.01)
