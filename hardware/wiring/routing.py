"""Where the cables run, and whether they can: the ways of the CAD, and routing.yml for options."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import dist, pi
from pathlib import Path
from typing import Any

from harness import HERE, WiringError, load, parts, read

sys.path.append(str(HERE.parent / "cad"))
import layout as cad  # found through the line above
import ways as lead_ways
from outlines import distance, inside, sampled
from parameters import Parameters
from parameters import read as parameters

Place = tuple[float, float, float]
SHOWN = ("minimal", "cutoff_mux")
"""Diagrams of the picture: the car of the paper with the recommended cut-off."""
LEVEL = 1.5
"""mm: middle of the plate; a lead is above it or below."""


@dataclass(frozen=True, slots=True)
class Route:
    """``points``: x, y, z [mm]; ``limit``: length of the cable that is bought, 0 = not said."""

    diagram: str
    cable: str
    pn: str
    wires: int
    colour: str
    ends: str
    points: tuple[Place, ...]
    limit: float

    @property
    def length(self) -> float:
        """Along the route [mm]."""
        return sum(dist(a, b) for a, b in zip(self.points, self.points[1:], strict=False))

    @property
    def passages(self) -> list[tuple[Place, Place]]:
        """Stretches that go from one side of the plate to the other."""
        return [(a, b) for a, b in zip(self.points, self.points[1:], strict=False)
                if (a[2] > LEVEL) != (b[2] > LEVEL)]


PLACES = (("infrared", "W_IR", 0), ("nano left", "W_IR", -1), ("imu", "W_IMU", 0),
          ("nano usb", "W_USB", 0), ("USB sockets", "W_USB", -1), ("lidar adapter", "W_LIDAR", 0),
          ("6-pin plug", "W_BOARD", 0), ("40-pin header", "W_BOARD", -1), ("servo", "W_SERVO", 0),
          ("channels 0, 1, 15", "W_SERVO", -1), ("ESC", "W_ESC", 0), ("LiPo", "W_PACK", 0),
          ("fuse", "W_PACK", -1))
"""Name of a place, and the lead that begins (0) or ends there (-1)."""


def computed(p: Parameters) -> dict[str, Place]:
    """Places that follow from the parameter file."""
    run, w = lead_ways.ways(p), p.base_windows
    known: dict[str, Place] = {f"@{name}": run[cable][end] for name, cable, end in PLACES}
    known["@nano right"] = (sum(w.nano_x) / 2 + 5, min(w.nano_y), -6)
    known["@cut-off"] = (p.upper.cutoff_x, p.upper.cutoff_y,
                         2 * p.sheet.thickness + p.stack.gap + p.cutoff.ledge)
    return known


@lru_cache(maxsize=1)
def known_parameters() -> Parameters:
    """The parameter file, read once."""
    return parameters()


def routes(folder: Path = HERE, p: Parameters | None = None) -> list[Route]:
    """Every routed cable. Raises WiringError for a place that is not known."""
    data, p = read(folder / "routing.yml"), p or known_parameters()
    known, found = computed(p), list[Route]()
    for diagram, some in {SHOWN[0]: lead_ways.ways(p), **data["routes"]}.items():
        drawing = load(diagram, folder)
        for cable, way in some.items():
            if cable not in drawing["cables"]:
                raise WiringError(f"routing.yml: {diagram}.yml has no cable {cable}; it has "
                                  f"{', '.join(drawing['cables'])}")
            entry = drawing["cables"][cable]
            for place in way:
                if isinstance(place, str) and place not in known:
                    raise WiringError(f"routing.yml, {cable}: no place {place!r}; there are "
                                      f"{', '.join(known)}")
            points = tuple(known[x] if isinstance(x, str) else tuple(x) for x in way)
            usb = str(entry["type"]).startswith("USB")
            found.append(Route(diagram, cable, entry["pn"], 1 if usb else entry["wirecount"],
                               "" if usb else (entry.get("colors") or [""])[-1],
                               _ends(drawing, cable, folder), points,
                               1000 * entry.get("length", 0.0)))
    return found


def _ends(drawing: dict[str, Any], cable: str, folder: Path) -> str:
    """"Nano - infrared": what the cable joins, once."""
    for chain in drawing["connections"]:
        a, w, b = (next(iter(link)) for link in chain)
        if w == cable:
            known = parts(folder)["connectors"]
            return " - ".join(known[x].get("short", known[x]["type"]) for x in (a, b))
    raise WiringError(f"routing.yml: {cable} connects nothing")


def openings(p: Parameters) -> list[tuple[str, list[tuple[float, float]], float]]:
    """Name, corners and area [mm2] of each way through the base plate for a lead."""
    sheet = cad.base_plate(p)
    found = [("hole for cables", [*sampled(cad.rectangle(h.x, h.y, h.diameter, h.diameter, 0,
                                                         0.999 * h.diameter / 2))],
              pi / 4 * h.diameter**2) for h in sheet.holes if h.use == "cables"]
    for cut in sheet.cuts:
        corners = sampled(cut.outline)
        area = abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(
            corners, corners[1:] + corners[:1], strict=True))) / 2
        found.append((cut.use, corners, area))
    return found


def faults(folder: Path = HERE, p: Parameters | None = None) -> list[str]:
    """What is wrong with the routes, by cable and rule. Raises WiringError."""
    p, data = p or known_parameters(), read(folder / "routing.yml")
    every = routes(folder, p)
    routed = {(r.diagram, r.cable) for r in every}
    found = [f"{cable} of {name}.yml has no route" for name in SHOWN
             for cable in load(name, folder)["cables"]
             if (name, cable) not in routed and cable not in data["kit"]]
    ways = openings(p)
    taken = dict.fromkeys(range(len(ways)), 0.0)
    for route in every:
        found += _of_one(route, data, p)
        for a, b in route.passages:
            at = [n for n, (_, corners, _) in enumerate(ways) if inside(a[:2], corners)]
            if dist(a[:2], b[:2]) > 0.1 or not at:
                found.append(f"{route.cable} passes the plate at x {a[0]:g}, y {a[1]:g}, where it "
                             "has no opening")
            for n in at:
                taken[n] += route.wires * pi / 4 * data["leads"].get(route.pn, 5.0) ** 2
    found += [f"the opening {ways[n][0]!r} of {ways[n][2]:.0f} mm2 takes {area:.0f} mm2 of leads; "
              f"expected at most {data['fill']:.0%}" for n, area in taken.items()
              if area > data["fill"] * ways[n][2]]
    return found


def _of_one(route: Route, data: dict[str, Any], p: Parameters) -> Iterator[str]:
    need = route.length + data["play"]
    if route.limit and need > route.limit:
        yield f"{route.cable} needs {need:.0f} mm, the cable has {route.limit:.0f}"
    outline, beyond = sampled(cad.base_outline(p)), data["beyond"]
    for a, b in zip(route.points, route.points[1:], strict=False):
        for n in range(11):
            x, y, z = (u + (v - u) * n / 10 for u, v in zip(a, b, strict=True))
            if z <= LEVEL:
                continue
            if dist((x, y), (p.lidar.axis_x, 0)) < data["rotor"]:
                yield f"{route.cable} enters the lidar's rotor at x {x:.0f}, y {y:.0f}"
                return
            over = 0.0 if inside((x, y), outline) else distance((x, y), outline)
            if over > beyond["rear" if x < 0 else "side"]:
                yield (f"{route.cable} hangs {over:.0f} mm over the edge of the plate at "
                       f"x {x:.0f}, y {y:.0f}")
                return
