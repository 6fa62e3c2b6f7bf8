"""Rules for the screws of the finished car: nothing in their way, a tool reaches both ends, no
metal close above a live board. Every complaint names the screw, the body and the rule.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import trimesh
from collisions import TOUCH, Bodies, shared
from fasteners import Fastener, fasteners
from parameters import Parameters
from screws import NUT, Screw, grip
from shapes import body, cylinder, turned

METAL = 8.0
"""mm of air that metal keeps above a live board: a screw that works loose tilts by its own head."""
LIVE = ("expansion_board", "jetson", "nano", "imu", "lidar_adapter")
"""Items whose first shape is a board under voltage."""
ROTOR_AIR = 3.0
LEADS = ("usb_nano", "usb_lidar", "lidar_lead", "cable_6pin", "jumpers", "lead_servo", "lead_esc",
         "battery_leads", "camera")
"""Items that hang or run free somewhere."""
DRIVER = (5.0, 60.0)
"""Diameter and length of a screwdriver's or a ball-end key's shaft, mm."""
SPANNER = (9.0, 40.0)
"""Width and length of the jaws of a flat spanner or pliers that hold a nut, mm; thick as it."""


def before(step: str) -> tuple[str, int]:
    """Steps in the order of the guide: deck, then options."""
    return step[0], int(step[1:])


def there(f: Fastener, bodies: Bodies, steps: dict[str, str]) -> Bodies:
    """Bodies that are around the screw when it is driven."""
    if f.row.beside:
        return {n: b for n, b in bodies.items() if n.startswith(f.row.beside)}
    return {n: b for n, b in bodies.items() if before(steps[n]) <= before(f.row.step)}


def hits(probe: trimesh.Trimesh, bodies: Bodies, spare: Iterable[str] = ()) -> list[str]:
    """Names of the bodies that a solid shares space with."""
    spare = tuple(s for s in spare if s)
    return [name for name, meshes in bodies.items() if not (spare and name.startswith(spare))
            and sum(shared(probe, m) for m in meshes) > TOUCH]


def seated(f: Fastener, report: dict[str, Any]) -> Iterator[str]:
    """The parts lie on each other: the car clamps what the table of the screws clamps."""
    told = grip(f.row, report["parts"])
    if abs(f.grip - told) > 0.05:
        yield f"{f.name}: parts do not lie on each other, {f.grip:.2f} mm for {told:.2f}"


def clash(f: Fastener, bodies: Bodies) -> Iterator[str]:
    """Head, shank and nut fill no space of another body; a shank may lie in its own part."""
    for kind, shape in f.pieces.items():
        spare = (f.row.through,) if kind == "shank" else ()
        for name in hits(body(shape), bodies, spare):
            yield f"{f.name}: its {kind} is in {name}"


def bites(f: Fastener, bodies: Bodies) -> Iterator[str]:
    """A screw that ends in a thread has 2 mm of it in the body that it is said to hold in."""
    if f.row.end != "thread":
        return
    shank = body(f.pieces["shank"])
    full = math.pi * (float(f.row.size[1:]) / 2) ** 2
    held_by = sum(shared(shank, m) for n, b in bodies.items() if n.startswith(f.row.through)
                  for m in b)
    if not f.row.through or held_by < 0.9 * 2.0 * full:
        yield f"{f.name}: {held_by / full:.1f} mm of thread in {f.row.through or 'nothing'}, 2.0 mm"


def near_rotor(p: Parameters, bodies: Bodies) -> Iterator[str]:
    """No cable within `ROTOR_AIR` of the turning part of the lidar."""
    c = p.lidar
    turning = body(cylinder((c.axis_x, 0, c.scan_z - 9 - ROTOR_AIR),
                            (c.axis_x, 0, c.top_z + ROTOR_AIR), c.rotor + ROTOR_AIR))
    for name in hits(turning, {n: b for n, b in bodies.items() if n in LEADS}):
        yield f"{name}: less than {ROTOR_AIR:g} mm beside the turning lidar"


def crossing(every: list[Fastener]) -> Iterator[str]:
    """No two fasteners meet."""
    solid = [(f, kind, body(s)) for f in every for kind, s in f.pieces.items()]
    for n, (f, kind, mesh) in enumerate(solid):
        for other, its, theirs in solid[n + 1:]:
            if other is not f and shared(mesh, theirs) > 0.01:
                yield f"{f.name}: its {kind} is in the {its} of {other.name}"


def driven(f: Fastener, around: Bodies) -> Iterator[str]:
    """A straight driver reaches the head."""
    if not f.row.length:
        return
    wide, long = DRIVER
    head = f.pieces["head"]
    high = math.dist(head["start"], head["end"])
    tool = body(cylinder(f.at(-high - long), f.at(-high), wide / 2, sides=16))
    for name in hits(tool, around):
        yield f"{f.name}: {name} is in the way of the driver"


def held(f: Fastener, around: Bodies) -> Iterator[str]:
    """A spanner gets at the nut from one side at least."""
    if f.row.end != "nut":
        return
    wide, long = SPANNER
    start = f.grip if f.row.length else -NUT[f.row.size]
    high = NUT[f.row.size]
    frame = turned(f.at(start), f.at(start + high))
    blocked: list[str] = []
    for k in range(12):
        jaw = trimesh.creation.box([long, wide, 0.9 * high])
        jaw.apply_translation([long / 2, 0, high / 2])
        jaw.apply_transform(trimesh.transformations.rotation_matrix(k * math.pi / 6, [0, 0, 1]))
        jaw.apply_transform(frame)
        if not (hit := hits(jaw, around)):
            return
        blocked += hit
    yield f"{f.name}: no side for a spanner at its nut, {', '.join(sorted(set(blocked)))} around"


def over_live(f: Fastener, boards: dict[str, trimesh.Trimesh]) -> Iterator[str]:
    """No metal within `METAL` mm above a live board, but what fastens that board."""
    if f.row.material != "steel":
        return
    own = {f.row.through} | ({"jetson"} if f.row.through.startswith("standoffs") else set())
    for name, board in boards.items():
        if name in own:
            continue
        (x0, y0, _), (x1, y1, top) = board.bounds
        for kind, shape in f.pieces.items():
            low, high = body(shape).bounds
            if low[0] < x1 and high[0] > x0 and low[1] < y1 and high[1] > y0 and (
                    -0.5 < (air := low[2] - top) < METAL):
                yield (f"{f.name}: its {kind} is {air:.1f} mm above the live {name}, "
                       f"{METAL:g} mm or no metal")


def problems(report: dict[str, Any], rows: list[Screw], bodies: Bodies) -> list[str]:
    """All complaints about the screws of a car; empty for one that can be screwed together."""
    steps = {i["name"]: i["step"] for i in report["items"] + report["placements"]}
    boards = {i["name"]: body(i["shapes"][0]) for i in report["items"] if i["name"] in LIVE}
    every = fasteners(report, rows)
    found = [f"{row.step} {row.name}: {n} in the car, {row.pieces} in screws.csv" for row in rows
             if (n := sum(f.row is row for f in every)) != row.pieces]
    for f in every:
        around = there(f, bodies, steps)
        found += [*seated(f, report), *clash(f, bodies), *bites(f, bodies), *driven(f, around),
                  *held(f, around), *over_live(f, boards)]
    return found + list(crossing(every))


def car(report: dict[str, Any], stl: Any) -> Bodies:
    """Every body of the assembly by name, from the table and the meshes."""
    bodies = {i["name"]: [body(s) for s in i["shapes"]] for i in report["items"]}
    for place in report["placements"]:
        mesh = trimesh.load_mesh(stl / f"{place['part']}.stl")
        mesh.apply_transform(np.array(place["matrix"]))
        bodies[place["name"]] = [mesh]
    return bodies
