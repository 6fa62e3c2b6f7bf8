"""Envelopes of the bought parts on the deck: enough to see them and to find collisions.

Simplified from data sheets and photographs; positions follow `parameters.toml`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from layout import grid, lidar_points
from parameters import Parameters
from shapes import Shape, box, cylinder, hull, prism

MOTOR_AHEAD = 54.0
"""Lidar's axis to its motor, mm: 102 long [data sheet] less both round ends."""
CUP = 4.6
"""Outer radius of the cups around the lidar's screws, mm [photo]."""
ROTOR = "#2146b4"
GREEN, BLUE, BLACK, DARK = "#1f7a48", "#2460a8", "#2a2b2f", "#45474d"
SILVER, BRASS, WHITE, RED = "#c7c9cc", "#c9a23f", "#efefef", "#b3261e"


CSI_X = 53.0, 75.0
"""Camera connector of the Jetson along the car, mm [assumed]; it opens to the right."""


@dataclass(frozen=True)
class Item:
    """A bought part: `bom` is its id in bom.csv, mass in g, step of the build it appears in."""

    name: str
    bom: str
    mass: float
    step: str
    shapes: tuple[Shape, ...]


def deck_top(p: Parameters) -> float:
    """Upper side of the base plate, mm."""
    return p.sheet.thickness


def roof_low(p: Parameters) -> float:
    """Underside of the upper plate, mm."""
    return p.sheet.thickness + p.stack.gap


def standoffs(p: Parameters) -> list[Item]:
    """Hexagons under and over the Jetson, posts of the expansion board; `fasteners` has their
    screws, nuts and studs."""
    z1 = deck_top(p) + p.stack.standoff_lower
    z2, z3 = z1 + p.stack.jetson_pcb, roof_low(p)
    lower, upper = [], []
    for x, y in grid(p.jetson.x, p.jetson.y):
        lower += [cylinder((x, y, a), (x, y, b), 2.88, BRASS, sides=6)
                  for a, b in ((deck_top(p), z1 - 25), (z1 - 25, z1))]
        upper.append(cylinder((x, y, z2), (x, y, z3), 2.88, BRASS, sides=6))
    posts = [cylinder((x, y, p.car.board_z), (x, y, 0), 2.5, BLACK, sides=6)
             for x, y in grid(p.board_posts.x, p.board_posts.y)]
    mass = p.mass.standoffs
    return [Item("standoffs_lower", "standoff_25", 0.7 * mass, "S08", tuple(lower)),
            Item("standoffs_upper", "standoff_5", 0.15 * mass, "S12", tuple(upper)),
            Item("board_posts", "kit", 0.15 * mass, "S07", tuple(posts))]


def jetson(p: Parameters) -> Item:
    """Kit upside down: fan below, ports to the rear, 40-pin header left."""
    z = deck_top(p) + p.stack.standoff_lower
    x0, x1 = p.jetson.x[0] - 18.0, p.jetson.x[1] + 4.4
    y = sum(p.jetson.y) / 2
    shapes = [box(x0, x1, y - 50, y + 50, z, z + p.stack.jetson_pcb, GREEN),
              box(38.5, 84, y - 35, y + 35, z - 6, z, GREEN),
              box(42, 81, y - 30, y + 30, z - 10, z - 6, SILVER)]
    shapes += [box(42, 81, y - 30 + 6.4 * i, y - 28 + 6.4 * i, z - 24, z - 10, SILVER)
               for i in range(10)]
    shapes += [cylinder((61.5, y, z - 27.4), (61.5, y, z - 24), 20, DARK, inner=18.5),
               cylinder((61.5, y, z - 27.4), (61.5, y, z - 24), 7, DARK)]
    for at, wide, high, colour in ((38, 9, 3.5, SILVER), (24, 16, 13.5, SILVER),
                                   (7, 14, 16, BLUE), (-9, 14, 16, BLUE), (-24, 13, 12, SILVER),
                                   (-38, 9, 11, BLACK)):  # micro-USB ... DC jack
        shapes.append(box(15, 31, y + at - wide / 2, y + at + wide / 2, z - high, z, colour))
    shapes += [box(38.5, 89, y + 45, y + 50, z - 8.5, z, BLACK),
               box(*CSI_X, y - 48, y - 43, z - 5.5, z, WHITE)]
    return Item("jetson", "jetson", p.mass.jetson, "S10", tuple(shapes))


def lidar(p: Parameters) -> Item:
    """Pan with four open cups for its screws, blue rotor, motor that hangs through the arc.

    Its screws go in from above: nothing of it may stand over the cups.
    """
    c, low = p.lidar, deck_top(p) + p.lidar.pillar
    top, x, motor = c.top_z, c.axis_x, c.axis_x + MOTOR_AHEAD
    split = c.scan_z - 9
    shapes = [prism(hull([(x, 0, c.rotor - 1.5), (motor, 0, 12.5)]), low, split - 2, BLACK),
              cylinder((motor, 0, top - 63), (motor, 0, low), 11.5, SILVER),
              cylinder((motor, 0, split - 2), (motor, 0, split + 4), 5, ROTOR),
              cylinder((x, 0, split - 2), (x, 0, split), c.rotor - 3, DARK),
              cylinder((x, 0, split), (x, 0, top - 1.5), c.rotor, ROTOR),
              cylinder((x, 0, top - 1.5), (x, 0, top), c.rotor - 2, "#2f57c4")]
    for turn in (0, 75, 180, 255):  # openings in the side of the rotor
        a = math.radians(turn)
        shapes.append(cylinder((x + (c.rotor - 4) * math.cos(a), (c.rotor - 4) * math.sin(a),
                                (split + top) / 2),
                               (x + (c.rotor + 0.2) * math.cos(a),
                                (c.rotor + 0.2) * math.sin(a), (split + top) / 2), 5.5, "#14161c"))
    for hx, hy in lidar_points(p):
        shapes += [cylinder((hx, hy, low), (hx, hy, low + c.ear), CUP, BLACK, inner=1.7),
                   cylinder((hx, hy, low + c.ear), (hx, hy, low + c.ear + 4), CUP, BLACK,
                            inner=CUP - 1.0)]
        if hx > x:
            y0, y1 = sorted((math.copysign(8.0, hy), math.copysign(abs(hy) - CUP, hy)))
            shapes.append(box(hx - 3, hx + 3, y0, y1, low, low + c.ear, BLACK))
    return Item("lidar", "lidar", p.mass.lidar, "S11", tuple(shapes))


def nano(p: Parameters) -> Item:
    """Pins down through both slots, USB forward."""
    w, m, z = p.base_windows, p.imu_nano, deck_top(p)
    x, y = sum(w.nano_x) / 2, sum(w.nano_y) / 2
    a, b = m.nano_length / 2, m.nano_width / 2
    shapes = [box(x - a, x + a, y - b, y + b, z, z + 1.6, BLUE),
              box(x + a - 7, x + a + 1.8, y - 3.85, y + 3.85, z + 1.6, z + 5.5, SILVER),
              box(x - 6, x + 1, y - 3.5, y + 3.5, z + 1.6, z + 2.8, BLACK),
              cylinder((x + 8, y, z + 1.6), (x + 8, y, z + 3.4), 2, WHITE)]
    for side in (-7.62, 7.62):
        shapes.append(box(x - 19, x + 19, y + side - 1.25, y + side + 1.25, z - 2.5, z, BLACK))
        shapes += [box(x - 17.78 + 2.54 * i - 0.3, x - 17.78 + 2.54 * i + 0.3, y + side - 0.3,
                       y + side + 0.3, z - 8.5, z - 2.5, BRASS) for i in range(15)]
    return Item("nano", "nano", p.mass.nano, "S13", tuple(shapes))


def imu(p: Parameters) -> Item:
    """Board on the four posts of its seat, chip in the middle."""
    z = deck_top(p) + p.imu_nano.floor + p.imu_nano.post
    x = p.base_holes.imu_x
    shapes = [box(x - 13.35, x + 13.35, -10.15, 10.15, z, z + 1.6, "#20356e"),
              box(x - 2.6, x + 2.6, -1.9, 1.9, z + 1.6, z + 2.7, BLACK)]
    return Item("imu", "imu", p.mass.imu, "S08", tuple(shapes))


def camera(p: Parameters) -> Item:
    """Board on the wall of the bracket. Its flat cable runs back below the screws of the bracket,
    over the Jetson, is folded to the right and goes round the board's edge into the connector."""
    x = p.upper.outline_left[-2] + p.camera.wall
    deck = roof_low(p) + p.sheet.thickness
    z = deck + p.camera.lens_above
    low = roof_low(p) - p.camera.jaw - 2.3  # below the button heads of the bracket
    over = deck_top(p) + p.stack.standoff_lower + p.stack.jetson_pcb + 0.5
    edge, (c0, c1) = sum(p.jetson.y) / 2 - 50.0, CSI_X
    a, b = c0 + 3, c1 - 3
    socket = over - p.stack.jetson_pcb - 3.0
    shapes = [box(x, x + 1, -12.5, 12.5, z - 9.5, z + 14.5, GREEN),
              box(x + 1, x + 6, -6, 6, z - 6, z + 6, BLACK),
              cylinder((x + 6, 0, z), (x + 15, 0, z), 7, BLACK),
              cylinder((x + 15, 0, z), (x + 17, 0, z), 5.5, "#2c3e66"),
              box(x - 3, x, -10.5, 10.5, z - 9, z - 4, WHITE),
              box(x - 3, x - 2.7, -8, 8, low, z - 9, WHITE),
              box(p.jetson.x[1] + 6, x - 2.7, -8, 8, low - 0.3, low, WHITE),
              box(p.jetson.x[1] + 6, p.jetson.x[1] + 6.3, -8, 8, low - 0.3, over + 0.6, WHITE),
              box(a, p.jetson.x[1] + 6.3, -8, 8, over + 0.3, over + 0.6, WHITE),
              box(a, b, edge - 2, 8, over, over + 0.3, "#f7d9a8"),
              box(a, b, edge - 2.3, edge - 2, socket - 0.3, over + 0.3, "#f7d9a8"),
              box(a, b, edge - 2.3, edge + 2, socket - 0.3, socket, "#4a7bd0")]
    return Item("camera", "camera", p.mass.camera, "S12", tuple(shapes))


def leads(p: Parameters) -> list[Item]:
    """Lidar adapter and antennas; they carry the mass of all cables."""
    h = p.base_holes
    z = deck_top(p)
    (x0, x1), (y0, y1) = h.adapter_x, h.adapter_y
    shapes = [box(x0 - 3, x1 + 3, y0 - 2.5, y1 + 2.5, z + 3, z + 4.6, BLUE),
              box(x0 + 4, x1 - 4, y0 - 3, y0 + 4, z + 4.6, z + 8, SILVER),
              box(x0 + 3, x1 - 3, y1 - 8, y1 - 1, z + 4.6, z + 10, WHITE)]
    shapes += [cylinder((x, y, z), (x, y, z + 3), 2.5, WHITE)
               for x, y in grid(h.adapter_x, h.adapter_y)]
    antennas = [cylinder((h.antenna_x, (a + b) / 2, -6), (h.antenna_x, (a + b) / 2, 128), 4.2,
                         BLACK) for a, b in zip(h.antenna_y, p.upper.antenna_y, strict=True)]
    return [Item("lidar_adapter", "lidar_adapter", 0.15 * p.mass.cables, "S08", tuple(shapes)),
            Item("antennas", "antennas", 0.2 * p.mass.cables, "S09", tuple(antennas))]


def cutoff_board(p: Parameters) -> Item:
    """Perforated board with a 16-pin chip in the holder of the optional cut-off."""
    c, u = p.cutoff, p.upper
    z = roof_low(p) + p.sheet.thickness + 2.0 + c.ledge
    x, y = u.cutoff_x, u.cutoff_y
    a, b = c.board_length / 2, c.board_width / 2
    shapes = (box(x - a, x + a, y - b, y + b, z, z + 1.6, "#b08a3c"),
              box(x - 9.8, x + 9.8, y - 3.2, y + 3.2, z + 1.6, z + 5.4, BLACK))
    return Item("cutoff_board", "perfboard", 5.0, "W09", shapes)


def deck_items(p: Parameters) -> list[Item]:
    return [*standoffs(p), jetson(p), lidar(p), nano(p), imu(p), camera(p), *leads(p),
            cutoff_board(p)]
