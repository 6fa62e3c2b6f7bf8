"""Angles that hold the back plate, and the printed stand-in for the brass rings of the shocks."""

from __future__ import annotations

import build123d as bd
from geometry import Part, X, Z, block, drill, prism, screw_bore
from outlines import polygon
from parameters import Parameters


def angle(p: Parameters, name: str, size: float, hole: float, slot: float) -> Part:
    """Two legs and two webs; one leg lies on the bed, the other stands at x = 0."""
    h = p.holders
    half = h.width / 2
    body = block(0, size, -half, half, 0, h.leg) + block(0, h.leg, -half, half, 0, size)
    lip = 0.5 * h.leg  # blunt ends: a web that runs out to nothing does not print
    corners = polygon([(0, 0), (size, 0), (size, lip), (lip, size), (0, size)])
    web = bd.Rot(90, 0, 0) * prism(corners, 0, h.web)  # stands up, y from -web to 0
    body += bd.Pos(0, half, 0) * web
    body += bd.Pos(0, -half + h.web, 0) * web
    bores = [screw_bore(p, "M3", (hole, 0, h.leg / 2), Z, h.leg, "plate"),
             screw_bore(p, "M3", (h.leg / 2, 0, hole), X, h.leg, "back_plate", slot, Z)]
    return Part(name, drill(body, bores), tuple(bores), "printed", p.printer.wall_min, "#d9822b")


def shock_ring(p: Parameters) -> Part:
    s = p.shock
    tube = bd.Cylinder(s.outer / 2, s.length) - bd.Cylinder(s.bore / 2, s.length)
    return Part("shock_ring", bd.Pos(0, 0, s.length / 2) * tube, (), "printed",
                p.printer.wall_min_gate, "#c9a227")


def parts(p: Parameters) -> list[Part]:
    h = p.holders
    return [angle(p, "board_holder", h.size, h.hole, 0.0),
            angle(p, "small_board_holder", h.small_size, h.small_hole, h.oblong), shock_ring(p)]
