"""Fit coupon: what has to fit, printed in half an hour before the parts are."""

from __future__ import annotations

import build123d as bd
from geometry import Bore, Part, Z, block, drill
from layout import ISO_273_FINE
from parameters import Parameters

LENGTH, WIDTH, THICK = 66.0, 30.0, 4.0
STEPS = (-0.1, 0.0, 0.1)
"""mm by which the three tries of a fit differ; the middle one is the parameter's."""


def fit_coupon(p: Parameters) -> Part:
    """Bores for the hub of the main gear, magnet pockets, slots for the sheet, screw holes.

    In each row the middle one is as in the parts, the one nearer to the arrow's tail 0.1 mm
    smaller, the other 0.1 mm larger. x along the coupon.
    """
    g, r = p.gear, p.rings
    body = block(0, LENGTH, 0, WIDTH, 0, THICK)
    bores = [Bore((8.0 + 12.5 * n, 8.0, THICK / 2), Z, g.hub + g.hub_play + s, THICK, "", "hub")
             for n, s in enumerate(STEPS)]
    bores += [Bore((10.0 + 10.0 * n, 18.5, THICK / 2), Z,
                   ISO_273_FINE[screw] + p.printer.hole_extra, THICK, "", screw)
              for n, screw in enumerate(("M2", "M2.5", "M3"))]
    body = drill(body, bores)
    for n, s in enumerate(STEPS):
        body -= bd.Pos(44.0 + 7.0 * n, 8.0, THICK) * bd.Cylinder(
            (r.magnet_diameter + r.magnet_play + s) / 2, 2 * r.magnet_depth)
        half = (p.sheet.thickness + p.sheet.slot_play + s) / 2
        x = 42.0 + 9.0 * n
        body -= block(x - half, x + half, 16.0, WIDTH + 1, -1, THICK + 1)
    body -= block(4, 32, 24.5, 25.5, THICK - 0.6, THICK + 1)  # arrow: larger to its head
    body -= bd.extrude(bd.Plane((32, 25, THICK - 0.6)) * bd.Triangle(a=5, b=5, c=5, rotation=-90),
                       amount=2)
    return Part("fit_coupon", body, tuple(bores), "printed", p.printer.wall_min, "#d9822b")


def parts(p: Parameters) -> list[Part]:
    return [fit_coupon(p)]
