"""Clamp on the upper plate that holds the camera upright in the notch, with a short hood."""

from __future__ import annotations

from geometry import Part, X, Y, block, drill, prism, screw_bore
from outlines import polygon
from parameters import Parameters


def camera_bracket(p: Parameters) -> Part:
    """Profile in x (forward, 0 = inner end of the slot) and y (up), extruded across the car.

    Printed on its side. Both windows take the parts and the flat-cable connector on the back of
    the camera board, which lies flush on the wall; the cable leaves below and goes back under
    the lower jaw.
    """
    c = p.camera
    slot = p.sheet.thickness + p.sheet.slot_play
    d, jaw, w = c.depth, c.jaw, c.width
    deck = jaw + slot - p.sheet.slot_play / 2  # upper plate's top
    lens = deck + c.lens_above
    top = lens + c.pitch_v + 4.0  # 2 mm of camera board above its upper holes, 2 mm of air
    roof = 2.4
    profile = [(0, 0), (d + c.wall, 0), (d + c.wall, top), (d + c.wall + c.hood, top),
               (d + c.wall + c.hood, top + roof), (d, top + roof), (d, jaw + slot + jaw + 2),
               (d - 2, jaw + slot + jaw), (0, jaw + slot + jaw), (0, jaw + slot),
               (d, jaw + slot), (d, jaw), (0, jaw)]
    if c.hood == 0:
        profile = [*profile[:3], (d + c.wall, top + roof), *profile[5:]]
    body = prism(polygon(profile[::-1]), 0, w)
    body -= block(d, d + c.wall + 1, -1, lens - 3.2, w / 2 - 12.5, w / 2 + 12.5)
    body -= block(d - 6, d + c.wall + 1, deck + 4.2, lens + 6.2, w / 2 - 8.0, w / 2 + 8.0)
    # Bar before the cable: guards it and carries the upper leg while it prints.
    body += block(d + c.wall - 1.8, d + c.wall, 0, 2.4, w / 2 - 13, w / 2 + 13)
    bores = [screw_bore(p, "M2", (d + c.wall / 2, lens + v, w / 2 + s * c.pitch_u / 2), X,
                        c.wall, "camera") for v in (0, c.pitch_v) for s in (-1, 1)]
    reach = d - (p.upper.outline_left[-2] - p.upper.camera_x)  # screw from the inner end
    bores += [screw_bore(p, "M3", (reach, y, w / 2 + s * p.upper.camera_half), Y, jaw,
                         "upper_plate")
              for y in (jaw / 2, jaw + slot + jaw / 2) for s in (-1, 1)]
    return Part("camera_bracket", drill(body, bores), tuple(bores), "printed", p.printer.wall_min,
                "#d9822b")


def parts(p: Parameters) -> list[Part]:
    return [camera_bracket(p)]
