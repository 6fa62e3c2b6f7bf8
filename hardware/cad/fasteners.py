"""Screws, studs and nuts as solids in the car, from screws.csv and the holes of built.json.

No CAD kernel: the build, the pictures and the tests make the same bodies. A fastener is found where
the holes of one row lie on one line; it begins where the first of its parts begins.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapes import Shape, Vector, cylinder

HARDWARE = str(Path(__file__).resolve().parents[1])
if HARDWARE not in sys.path:
    sys.path.append(HARDWARE)
from screws import NUT, STUD, Screw  # noqa: E402 - found through the line above

Array = NDArray[np.float64]
ACROSS = {"M2": 4.0, "M2.5": 5.0, "M3": 5.5}
"""Nuts across flats, mm (ISO 4032)."""
HEADS = {("M2", "cap"): (3.8, 2.0), ("M2.5", "cap"): (4.5, 2.5), ("M3", "cap"): (5.5, 3.0),
         ("M3", "button"): (5.7, 1.65), ("M2", "pan"): (4.0, 1.6), ("M3", "pan"): (5.6, 2.4)}
"""Diameter and height of the head, mm (ISO 4762, ISO 7380-1, ISO 7045)."""
WAYS: dict[str, Vector] = {"up": (0, 0, 1), "down": (0, 0, -1), "front": (1, 0, 0),
                           "rear": (-1, 0, 0), "left": (0, 1, 0), "right": (0, -1, 0)}
"""Direction in which a screw is driven, head last."""
COLOUR = {"steel": "#5d6167", "nylon": "#f2f0e4"}
ON_LINE = 1.0
"""mm beside the line at which a hole still takes the screw: the oblong ones need 0.8."""


@dataclass(frozen=True)
class Fastener:
    """One screw with its nut, or a nut on a stud. ``seat`` is the middle of the face below the
    head, ``grip`` [mm] what lies between head and nut, found in the placed parts."""

    name: str
    row: Screw
    seat: Vector
    grip: float

    @property
    def way(self) -> Array:
        return np.array(WAYS[self.row.drive], dtype=float)

    def at(self, along: float) -> Vector:
        """Point of the axis, mm beyond the seat."""
        x, y, z = np.array(self.seat) + along * self.way
        return float(x), float(y), float(z)

    def rod(self, start: float, end: float, diameter: float, sides: int = 24) -> Shape:
        return cylinder(self.at(start), self.at(end), diameter / 2, COLOUR[self.row.material],
                        sides=sides)

    @property
    def pieces(self) -> dict[str, Shape]:
        """Bodies by name: head, shank, nut, whichever there are."""
        row, found = self.row, {}
        if row.length:
            wide, high = HEADS[row.size, row.head]
            found["head"] = self.rod(-high, 0.0, wide)
            found["shank"] = self.rod(0.0, row.length, float(row.size[1:]))
        else:
            found["shank"] = self.rod(self.grip - STUD, self.grip, float(row.size[1:]))
        if row.end == "nut":
            across = ACROSS[row.size] / np.cos(np.pi / 6)
            start, end = (self.grip, self.grip + NUT[row.size]) if row.length else (
                -NUT[row.size], 0.0)
            found["nut"] = self.rod(start, end, across, sides=6)
        return found


def holes_of(report: dict[str, Any], part: str, use: str) -> list[tuple[Array, Array, float]]:
    """(middle, axis, length) of every hole for this use of every placed part of this name."""
    found = []
    for place in report["placements"]:
        if place["part"] == part:
            m = np.array(place["matrix"])
            found += [(m[:3, :3] @ h["at"] + m[:3, 3], m[:3, :3] @ h["axis"], h["length"])
                      for h in report["parts"][part]["holes"] if h["use"] == use]
    return found


def of_row(report: dict[str, Any], row: Screw) -> list[Fastener]:
    """Every fastener of one row, in the car."""
    way = np.array(WAYS[row.drive], dtype=float)
    groups = [[h for h in holes_of(report, *key) if abs(h[1] @ way) > 0.99]
              for key in dict.fromkeys(row.holes)]
    found: list[Fastener] = []
    for at, _, _ in groups[0]:
        line = [h for group in groups for h in group
                if np.linalg.norm(np.cross(h[0] - at, way)) < ON_LINE]
        spot = tuple(np.round(at - (at @ way) * way, 3))
        if any(np.allclose(spot, f.at(0) - (np.array(f.at(0)) @ way) * way, atol=ON_LINE)
               for f in found) or any(
                   all(h[0] is not g[0] for h in line for g in group) for group in groups):
            continue
        ends = [(h[0] @ way - h[2] / 2, h[0] @ way + h[2] / 2) for h in line]
        start, end = min(e[0] for e in ends), max(e[1] for e in ends)
        before = row.other if row.other_at == "head" else 0.0
        after = row.other if row.other_at == "tail" else 0.0
        flat = at - (at @ way) * way
        x, y, z = flat + (start - before) * way
        grip = float(end - start + before + after)
        where = f"{row.holes[0][0]}/{row.holes[-1][0]}"
        name = f"{row.step} {row.name} {where} at ({x:.1f}, {y:.1f}, {z:.1f})"
        found.append(Fastener(name, row, (float(x), float(y), float(z)), grip))
    return found


def fasteners(report: dict[str, Any], rows: list[Screw]) -> list[Fastener]:
    """All of the car, in the order of screws.csv."""
    return [f for row in rows for f in of_row(report, row)]

