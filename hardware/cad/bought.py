"""Envelopes of the bought parts on the deck: enough to see them and to find collisions.

Simplified from data sheets and photographs; positions follow `parameters.toml`.
"""

from __future__ import annotations

from dataclasses import dataclass

from layout import grid, imu_points, lidar_points
from parameters import Parameters
from shapes import Shape, box, cylinder, hull, prism

GREEN, BLUE, BLACK, DARK = "#1f7a48", "#2460a8", "#2a2b2f", "#45474d"
SILVER, BRASS, WHITE, RED = "#c7c9cc", "#c9a23f", "#efefef", "#b3261e"


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
    """Hexagons under and over the Jetson with their screws, posts of the expansion board."""
    z1 = deck_top(p) + p.stack.standoff_lower
    z2, z3 = z1 + p.stack.jetson_pcb, roof_low(p)
    top = z3 + p.sheet.thickness
    lower, upper, posts = [], [], []
    for x, y in grid(p.jetson.x, p.jetson.y):
        lower += [cylinder((x, y, a), (x, y, b), 2.88, BRASS, sides=6)
                  for a, b in ((deck_top(p), z1 - 25), (z1 - 25, z1))]
        lower.append(cylinder((x, y, -1.8), (x, y, 0), 2.25, DARK))
        upper += [cylinder((x, y, z2), (x, y, z3), 2.88, BRASS, sides=6),
                  cylinder((x, y, top), (x, y, top + 1.8), 2.25, DARK)]
    for x, y in grid(p.board_posts.x, p.board_posts.y):
        posts += [cylinder((x, y, p.car.board_z), (x, y, 0), 2.5, BLACK, sides=6),
                  cylinder((x, y, deck_top(p)), (x, y, deck_top(p) + 1.8), 2.25, DARK)]
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
    shapes.append(box(38.5, 89, y + 45, y + 50, z - 8.5, z, BLACK))
    return Item("jetson", "jetson", p.mass.jetson, "S10", tuple(shapes))


def lidar(p: Parameters) -> Item:
    """Body over the mount, rotor, motor that hangs through the front arc."""
    low = deck_top(p) + p.lidar.pillar
    top, x = p.lidar.top_z, p.lidar.axis_x
    split = p.lidar.scan_z - 9
    holes = [(hx, hy, 4.5) for hx, hy in lidar_points(p)]
    outline = hull([(x, 0, 35.5), *holes, (172, 0, 12.5)])
    shapes = [prism(outline, low, split - 2, BLACK),
              cylinder((172, 0, top - 63), (172, 0, low), 11.5, SILVER),
              cylinder((x, 0, split - 2), (x, 0, split), 31, DARK),
              cylinder((x, 0, split), (x, 0, top - 1.5), 34, "#232327"),
              cylinder((x, 0, top - 1.5), (x, 0, top), 32, "#38383d"),
              *(cylinder((x + 28, y, (split + top) / 2), (x + 34.3, y, (split + top) / 2), 7,
                         "#6b1626") for y in (-11, 11))]
    return Item("lidar", "lidar", p.mass.lidar, "S08", tuple(shapes))


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
    shapes += [cylinder((hx, hy, z + 1.6), (hx, hy, z + 3.4), 2.25, SILVER)
               for hx, hy in imu_points(p)]
    return Item("imu", "imu", p.mass.imu, "S08", tuple(shapes))


def camera(p: Parameters) -> Item:
    """Board on the wall of the bracket; the flat cable goes back under the upper plate."""
    x = p.upper.outline_left[-2] + p.camera.wall
    deck = roof_low(p) + p.sheet.thickness
    z = deck + p.camera.lens_above
    ribbon = roof_low(p) - p.camera.jaw - 0.6
    shapes = [box(x, x + 1, -12.5, 12.5, z - 9.5, z + 14.5, GREEN),
              box(x + 1, x + 6, -6, 6, z - 6, z + 6, BLACK),
              cylinder((x + 6, 0, z), (x + 15, 0, z), 7, BLACK),
              cylinder((x + 15, 0, z), (x + 17, 0, z), 5.5, "#2c3e66"),
              box(x - 3, x, -10.5, 10.5, z - 9, z - 4, WHITE),
              box(x - 3, x - 2.7, -8, 8, ribbon, z - 9, WHITE),
              box(60, x - 2.7, -8, 8, ribbon - 0.3, ribbon, WHITE)]
    return Item("camera", "camera", p.mass.camera, "S11", tuple(shapes))


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
    return [Item("lidar_adapter", "lidar_adapter", 0.6 * p.mass.cables, "S08", tuple(shapes)),
            Item("antennas", "antennas", 0.4 * p.mass.cables, "S09", tuple(antennas))]


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
