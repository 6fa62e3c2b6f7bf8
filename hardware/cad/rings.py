"""Both rings on the main gear: white teeth for infrared light, magnets for the Hall switch."""

from __future__ import annotations

import math

import build123d as bd
import layout
from geometry import Bore, Part, Z, drill, from_sheet
from parameters import Parameters


def magnet_ring(p: Parameters) -> Part:
    """Disc on the hub with blind holes; the magnets go in from above, all the same pole up."""
    r = p.rings
    thick = r.magnet_floor + r.magnet_depth
    bore = Bore((0, 0, thick / 2), Z, p.gear.hub + p.gear.hub_play, thick, "", "hub")
    pockets = [Bore((r.magnet_radius * math.cos(a), r.magnet_radius * math.sin(a),
                     thick - r.magnet_depth / 2), Z, r.magnet_diameter + r.magnet_play,
                    r.magnet_depth, "", "magnet")
               for a in (2 * math.pi * i / r.magnets for i in range(r.magnets))]
    disc = bd.Pos(0, 0, thick / 2) * bd.Cylinder(r.magnet_ring_radius, thick)
    disc = drill(disc, [bore])
    for pocket in pockets:  # blind: cut from the upper face only
        disc -= bd.Pos(pocket.at[0], pocket.at[1], thick) * bd.Cylinder(
            pocket.diameter / 2, 2 * r.magnet_depth)
    return Part("magnet_ring", disc, (bore, *pockets), "printed", p.printer.wall_min, "#3c4450")


def parts(p: Parameters) -> list[Part]:
    return [magnet_ring(p), from_sheet(layout.striped_ring(p), "#f4f4f0", p.sheet.web_min)]
