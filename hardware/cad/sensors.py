"""Gate before the infrared module and holder of the Hall switch."""

from __future__ import annotations

import build123d as bd
from geometry import Part, block, prism, rod
from outlines import polygon
from parameters import Parameters


def sensor_gate(p: Parameters) -> Part:
    """Hood over both LEDs that sees the ring through a slit only.

    Seen from above: x to the right, y to the rear (towards the gear). Printed roof down, so the
    open floor is on top and nothing needs support.
    """
    g = p.gate
    w, d, h, t = g.width, g.depth, g.height, g.wall
    nose = 3.0  # half width of the wall with the slit
    left, right = g.slit_x - nose, g.slit_x + nose
    outer = [(0, 0), (w, 0), (w, d - 5), (right, d), (left, d), (0, d - 7)]
    inner = [(t, -1), (w - t, -1), (w - t, d - 5 - 0.5 * t), (right - 0.3 * t, d - t),
             (left + 0.3 * t, d - t), (t, d - 7 - 0.6 * t)]
    hood = prism(polygon(outer), 0, h) - prism(polygon(inner), g.roof, h + 1)
    half = g.slit / 2
    hood -= block(g.slit_x - half, g.slit_x + half, d - 2 * t, d + 1, g.roof, h - g.sill)
    return Part("sensor_gate", hood, (), "printed", p.printer.wall_min_gate, "#3a3b40")


def hall_holder(p: Parameters) -> Part:
    """Plate on the face of the rear gearbox, collar below the bearing boss, column to the left.

    x to the left, y up, z forward to the gear; the shaft is at x = y = 0. The switch lies in the
    pocket on top, branded face to the gear, leads to the left through the groove.
    """
    h = p.hall
    bore, top = h.boss + h.boss_play, h.face_to_ring - h.air_gap
    radius = p.rings.magnet_radius
    plate = block(-10, radius + 5, -11, 4.2, 0, 2.4)
    collar = rod((0, 0, h.boss_length / 2), (0, 0, 1), bore + 5, h.boss_length)
    collar &= block(-20, 20, -20, 0, 0, 20)
    long, wide = h.sensor_x + h.sensor_play, h.sensor_y + h.sensor_play
    column = block(radius - wide / 2 - 1.4, radius + 5, -long / 2 - 2, long / 2 + 2, 0, top)
    body = plate + collar + column
    body -= rod((0, 0, 0), (0, 0, 1), bore, 4 * top)
    body -= block(-bore / 2, bore / 2, 0, 20, -1, 4 * top)  # open above: slides on from below
    body -= block(radius - wide / 2, radius + wide / 2, -long / 2, long / 2,
                  top - h.sensor_z, top + 1)
    body -= block(radius, radius + 6, -2, 2, top - 1.0, top + 1)
    return Part("hall_holder", bd.Part(body.wrapped), (), "printed", p.printer.wall_min, "#5b6b3a")


def parts(p: Parameters) -> list[Part]:
    return [sensor_gate(p), hall_holder(p)]
