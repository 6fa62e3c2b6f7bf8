"""Parts as solids with a table of their holes, and frames that place them in the car.

Every part is modelled as it lies on the printer's bed or the cutter's table: z = 0 below,
millimetres. `frame` gives the matrix from there into the deck frame (X forward, Y left, Z up,
origin at the rear edge of the base plate's underside).
"""

from __future__ import annotations

from dataclasses import dataclass

import build123d as bd
import numpy as np
from layout import ISO_273_FINE, Sheet
from numpy.typing import NDArray
from outlines import Outline, middle, segments
from parameters import Parameters

Matrix = NDArray[np.float64]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Bore:
    """A hole of a part: a point on its axis half way through, direction, size in mm.

    `screw` is empty where no screw passes; `slot` is the extra length of an oblong hole along
    `slot_axis`.
    """

    at: tuple[float, float, float]
    axis: tuple[float, float, float]
    diameter: float
    length: float
    screw: str
    use: str
    slot: float = 0.0
    slot_axis: tuple[float, float, float] = X


@dataclass(frozen=True)
class Part:
    """One manufactured part. `wall_min` is the least wall it declares, mm."""

    name: str
    solid: bd.Solid | bd.Part
    bores: tuple[Bore, ...]
    process: str  # "printed" or "cut"
    wall_min: float
    colour: str
    sheet: Sheet | None = None


def wire(outline: Outline, z: float = 0.0) -> bd.Wire:
    """Closed wire of lines and arcs at height z."""
    edges = []
    for start, end, bulge in segments(outline):
        if bulge:
            edges.append(bd.Edge.make_three_point_arc((*start, z),
                                                      (*middle(start, end, bulge), z), (*end, z)))
        else:
            edges.append(bd.Edge.make_line((*start, z), (*end, z)))
    return bd.Wire(edges)


def prism(outline: Outline, z0: float, z1: float) -> bd.Part:
    """Upright solid over a closed outline."""
    return bd.extrude(bd.Face(wire(outline, z0)), amount=z1 - z0, dir=Z)


def block(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> bd.Part:
    """Box between two corners."""
    return bd.Pos((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2) * bd.Box(x1 - x0, y1 - y0, z1 - z0)


def rod(at: tuple[float, float, float], axis: tuple[float, float, float], diameter: float,
        length: float) -> bd.Part:
    """Cylinder about `at`, `length` along the axis, half to each side."""
    return bd.Plane(origin=at, z_dir=axis) * bd.Cylinder(diameter / 2, length)


def drill(solid: bd.Part, bores: list[Bore]) -> bd.Part:
    """Solid with its bores cut, oblong ones along their slot axis."""
    for bore in bores:
        half = np.asarray(bore.slot_axis) * bore.slot / 2
        for side in ((0,) if bore.slot == 0 else (-1, 1)):
            at = tuple(np.asarray(bore.at) + side * half)
            solid -= rod(at, bore.axis, bore.diameter, bore.length + 0.02)
        if bore.slot:
            solid -= _slot_middle(bore)
    return solid


def _slot_middle(bore: Bore) -> bd.Part:
    plane = bd.Plane(origin=bore.at, x_dir=bore.slot_axis, z_dir=bore.axis)
    return plane * bd.Box(bore.slot, bore.diameter, bore.length + 0.02)


def screw_bore(p: Parameters, screw: str, at: tuple[float, float, float],
               axis: tuple[float, float, float], length: float, use: str, slot: float = 0.0,
               slot_axis: tuple[float, float, float] = X) -> Bore:
    """Clearance hole of a printed part: ISO 273 fine plus what a printer takes away."""
    return Bore(at, axis, ISO_273_FINE[screw] + p.printer.hole_extra, length, screw, use, slot,
                slot_axis)


def from_sheet(sheet: Sheet, colour: str, web_min: float) -> Part:
    """A cut part: its sheet extruded from z = 0."""
    t = sheet.thickness
    holes = [bd.Wire(bd.Edge.make_circle(h.diameter / 2, bd.Plane((h.x, h.y, 0))))
             for h in sheet.holes]
    face = bd.Face(wire(sheet.outline), holes + [wire(c.outline) for c in sheet.cuts])
    if face.normal_at().Z < 0:
        face = -face
    bores = tuple(Bore((h.x, h.y, t / 2), Z, h.diameter, t, h.screw, h.use) for h in sheet.holes)
    return Part(sheet.name, bd.extrude(face, amount=t, dir=Z), bores, "cut", web_min, colour, sheet)


def frame(origin: tuple[float, float, float], x: tuple[float, float, float] = X,
          y: tuple[float, float, float] = Y) -> Matrix:
    """4 x 4 matrix that lays a part's x and y along these directions of the car."""
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x, y, np.cross(x, y)
    matrix[:3, 3] = origin
    return matrix
