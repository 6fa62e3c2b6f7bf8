"""Relations between parameters: what cannot be built is refused before anything is drawn."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import layout
from outlines import distance, inside, sampled
from parameters import FILE, ParameterError, Parameters, read

SCREW_PLAY = 0.3  # mm between an M3 screw and both of its holes, 0.2 + 0.4 across, halved


def at_least(p: Parameters, name: str, value: float, limit: float, why: str) -> Iterator[str]:
    """A complaint unless value >= limit; `name` is the parameter to correct."""
    if not value >= limit - 1e-9:
        yield f"{name}{shown(p, name)}: {why} = {value:.2f} mm, at least {limit:.2f} mm needed"


def at_most(p: Parameters, name: str, value: float, limit: float, why: str) -> Iterator[str]:
    if not value <= limit + 1e-9:
        yield f"{name}{shown(p, name)}: {why} = {value:.2f} mm, at most {limit:.2f} mm allowed"


def shown(p: Parameters, name: str) -> str:
    """Value and bounds of the parameters in a list of names "group.key, key"."""
    texts, group = [], ""
    for part in name.split(", "):
        group, key = part.split(".") if "." in part else (group, part)
        entry = p.raw[group][key]
        texts.append(f"{entry['value']} {entry['unit']}, bounds {entry['min']} to {entry['max']}")
    return f" ({'; '.join(texts)})"


def walls(p: Parameters) -> Iterator[str]:
    """No printed wall thinner than the printer makes."""
    least, thin = p.printer.wall_min, p.printer.wall_min_gate
    for name, value in (("holders.leg", p.holders.leg), ("holders.web", p.holders.web),
                        ("imu_nano.wall", p.imu_nano.wall), ("cutoff.wall", p.cutoff.wall),
                        ("camera.wall", p.camera.wall)):
        yield from at_least(p, name, value, least, "wall")
    yield from at_least(p, "gate.wall", p.gate.wall, thin, "wall of the gate")
    yield from at_least(p, "shock.outer, bore", (p.shock.outer - p.shock.bore) / 2, thin,
                        "wall of the shock ring")


def small_parts(p: Parameters) -> Iterator[str]:
    """Holes and pockets of the small printed parts lie inside them."""
    h, least, hole = p.holders, p.printer.wall_min, (3.2 + p.printer.hole_extra) / 2
    for name, size, at, slot in (("size, hole", h.size, h.hole, 0.0),
                                 ("small_size, small_hole, oblong", h.small_size, h.small_hole,
                                  h.oblong / 2)):
        yield from at_least(p, f"holders.{name}", size - at - slot - hole, least,
                            "leg beyond its hole")
        yield from at_least(p, f"holders.{name}", at - slot - hole - h.leg, 1.0,
                            "room for a nut in the corner")
    g = p.gate
    yield from at_least(p, "gate.slit_x", g.slit_x, 3.0 + g.wall, "slit from the left side")
    yield from at_most(p, "gate.slit_x, width", g.slit_x, g.width - 3.0 - g.wall,
                       "slit from the left side")
    hall = p.hall
    pocket = p.rings.magnet_radius - (hall.sensor_y + hall.sensor_play) / 2
    yield from at_least(p, "hall.boss, boss_play", pocket - (hall.boss + hall.boss_play) / 2,
                        least, "wall between boss and switch")
    yield from at_least(p, "hall.face_to_ring, air_gap, sensor_z",
                        hall.face_to_ring - hall.air_gap - hall.sensor_z, 2.4,
                        "holder behind the switch")


def rings(p: Parameters) -> Iterator[str]:
    """Both rings sit on the hub and turn inside the recess of the gear."""
    r, bore = p.rings, (p.gear.hub + p.gear.hub_play) / 2
    room = p.gear.recess / 2 - 0.5
    yield from at_most(p, "rings.tip", r.tip, room, "ring in the recess of the gear: radius")
    yield from at_most(p, "rings.magnet_ring_radius", r.magnet_ring_radius, room,
                       "ring in the recess of the gear: radius")
    yield from at_least(p, "rings.root, gear.hub", r.root - bore, p.sheet.web_min,
                        "material between bore and gap")
    tooth = math.pi * (r.root + r.tip) / 2 / r.teeth
    yield from at_least(p, "rings.teeth, root, tip, gate.slit", tooth, p.gate.slit,
                        "tooth and gap seen through the slit of the gate: width")
    hole = (r.magnet_diameter + r.magnet_play) / 2
    yield from at_least(p, "rings.magnet_radius, magnet_ring_radius",
                        r.magnet_ring_radius - r.magnet_radius - hole, p.printer.wall_min,
                        "wall outside the magnets")
    yield from at_least(p, "rings.magnet_radius, gear.hub", r.magnet_radius - hole - bore,
                        p.printer.wall_min, "wall inside the magnets")
    yield from at_least(p, "rings.magnets",
                        2 * r.magnet_radius * math.sin(math.pi / max(r.magnets, 2)) - 2 * hole,
                        p.printer.wall_min, "wall between magnets")
    yield from at_most(p, "gear.recess", p.gear.recess, p.gear.outer - 2, "recess in the gear")


def fits(p: Parameters) -> Iterator[str]:
    """Parts that must meet do meet."""
    pitch = p.back.hole_v[1] - p.back.hole_v[0]
    closed = p.holders.hole + pitch + p.holders.small_hole
    low = p.sheet.thickness + p.holders.hole
    for check, sign in ((at_least, -1), (at_most, 1)):
        yield from check(p, "back.hole_v, stack.gap, holders.hole, small_hole", closed,
                         p.stack.gap + sign * p.holders.oblong / 2, "gap that the brackets close")
        yield from check(p, "back.hole_v, sheet.thickness, holders.hole", p.back.hole_v[0],
                         low + sign * SCREW_PLAY, "lower holes of the back plate")
    used = p.stack.standoff_lower + p.stack.jetson_pcb + p.stack.standoff_upper
    yield from at_most(p, "stack.standoff_lower, standoff_upper, jetson_pcb", used,
                       p.stack.gap + p.holders.oblong / 2, "standoffs and Jetson in the gap")
    yield from at_most(p, "lidar.top_z", p.lidar.top_z,
                       p.sheet.thickness + p.stack.gap - p.camera.jaw - 2.0,
                       "lidar below the camera bracket")
    yield from at_least(p, "lidar.scan_z", p.lidar.scan_z,
                        p.sheet.thickness + p.lidar.pillar + 5, "scan plane above the lidar's body")
    reach = 1.9 if p.rings.magnet_depth < 1.5 else 2.3  # one magnet, two stacked
    yield from at_most(p, "hall.air_gap", p.hall.air_gap, reach, "air gap for 35 mT")
    notch = p.upper.outline_left[-1] - p.upper.outline_right[1]
    yield from at_most(p, "camera.width", p.camera.width, notch - 0.3, "bracket in the notch")
    b = p.base
    yield from at_least(p, "base.arc_radius, arc_x", b.arc_radius, b.arc_x - b.length + 1.0,
                        "front arc that reaches the plate: radius")


def bed(p: Parameters) -> Iterator[str]:
    """Plates may be printed, too: they fit the bed."""
    for name, value in (("base.length", p.base.length), ("base.half_width", 2 * p.base.half_width),
                        ("back.height", p.back.height)):
        yield from at_most(p, name, value, p.printer.bed, "length on the printer's bed")


def sheet_cuts(p: Parameters) -> Iterator[str]:
    """Holes and windows lie inside their sheet with `sheet.web_min` around each."""
    for sheet in layout.sheets(p):
        edge = sampled(sheet.outline)
        shapes = [(h.parameter, [(h.x, h.y)], h.diameter / 2) for h in sheet.holes]
        shapes += [(c.parameter, sampled(c.outline), 0.0) for c in sheet.cuts]
        for name, points, radius in shapes:
            here = f"{sheet.name} at ({points[0][0]:g}, {points[0][1]:g})"
            if not all(inside(q, edge) for q in points):
                yield f"{name}{shown(p, name)}: {here} lies outside the plate"
                continue
            web = min(distance(q, edge) for q in points) - radius
            yield from at_least(p, name, web, p.sheet.web_min, f"{here}: web to the edge")
        for (name, a, ra), (_, b, rb) in combinations(shapes, 2):
            web = min(distance(q, b) if len(b) > 1 else math.dist(q, b[0]) for q in a) - ra - rb
            if len(a) == 1 and len(b) > 1 and inside(a[0], b):
                web = -ra
            here = f"{sheet.name} ({a[0][0]:g}, {a[0][1]:g}) and ({b[0][0]:g}, {b[0][1]:g})"
            yield from at_least(p, name, web, p.sheet.web_min, f"{here}: web between two cuts")


def relations(p: Parameters) -> list[str]:
    """Everything that cannot be built, in words."""
    simple = [text for check in (walls, small_parts, rings, fits, bed) for text in check(p)]
    return simple + list(sheet_cuts(p))


def load(path: Path = FILE) -> Parameters:
    """Parameters that can be built. Raises ParameterError with every reason otherwise."""
    p = read(path)
    problems = relations(p)
    if problems:
        raise ParameterError(problems)
    return p
