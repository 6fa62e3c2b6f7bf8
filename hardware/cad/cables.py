"""Plugs and bundles of wire as solids at true scale, along the points of `ways`.

Radii: 2.2 mm USB, 1.8 mm a bundle of jumper wires, 2.4 mm both wires of a battery lead.
"""

from __future__ import annotations

from itertools import pairwise

from bought import BLACK, BLUE, RED, WHITE, Item, deck_top
from parameters import Parameters
from shapes import Shape, Vector, box, cylinder
from ways import JUMPER, T_PLUG, Way, fuse_front, module_pins, nano_middle, socket_low, ways

YELLOW, ORANGE = "#d8b23a", "#d9822b"
TIE = "#e8e4d8"


def bundle(points: Way, radius: float, colour: str) -> list[Shape]:
    """Straight pieces from point to point."""
    return [cylinder(a, b, radius, colour, sides=12) for a, b in pairwise(points)]


def free(way: Way) -> Way:
    """The lead between its plugs."""
    return way[1:-1]


def plug(end: Vector, start: Vector, half: tuple[float, float], colour: str) -> Shape:
    """Along x or y from the contact to where the lead comes out; half width and half height."""
    wide, high = half
    (x0, x1), (y0, y1), (z0, z1) = (sorted(v) for v in zip(end, start, strict=True))
    if x1 - x0 > y1 - y0:
        return box(x0, x1, y0 - wide, y1 + wide, z0 - high, z1 + high, colour)
    return box(x0 - wide, x1 + wide, y0, y1, z0 - high, z1 + high, colour)


def usb(p: Parameters, run: dict[str, Way]) -> list[Item]:
    """Nano and lidar adapter to the rear of the Jetson."""
    found = []
    for name, cable, bom, mass, half, colour in (
            ("usb_nano", "W_USB", "usb_mini", 0.2, (5.5, 3.5), BLUE),
            ("usb_lidar", "W_LIDAR", "usb_micro", 0.15, (5.5, 3.0), BLACK)):
        way = run[cable]
        shapes = (plug(way[0], way[1], half, colour), plug(way[-1], way[-2], (6.5, 3.5), colour),
                  *bundle(free(way), 2.2, colour))
        found.append(Item(name, bom, mass * p.mass.cables, "W03", shapes))
    return found


def six_wire(p: Parameters, way: Way) -> Item:
    """Its plug covers pins 1 to 6 of the header: two rows of three."""
    x, y, low = way[-2]
    shapes = (box(x - 3.8, x + 3.8, y - 2.5, y + 2.5, low, low + JUMPER, BLACK),
              *bundle(free(way), 1.8, ORANGE))
    return Item("cable_6pin", "cable_6pin", 0.05 * p.mass.cables, "W04", shapes)


def jumpers(p: Parameters, run: dict[str, Way]) -> Item:
    """Sockets below the Nano and on the infrared module, and both bundles."""
    (x, y), low, pin = nano_middle(p), socket_low(p), module_pins(p)
    pins = ((-7.62, (0, 3, 4, 8)), (7.62, (4, 7, 8, 11)))
    shapes = [box(x - 17.78 + 2.54 * n - 1.2, x - 17.78 + 2.54 * n + 1.2, y + s - 1.2, y + s + 1.2,
                  low, low + JUMPER, BLACK) for s, row in pins for n in row]
    shapes += [box(pin + 0.2, pin + JUMPER, k * 2.54 - 1.2, k * 2.54 + 1.2, p.car.floor_z + 2.2,
                   p.car.floor_z + 4.6, BLACK) for k in (-1, 0, 1)]
    shapes += bundle(free(run["W_IR"]), 1.8, "#d39a1e")
    shapes += bundle(free(run["W_IMU"]), 1.6, "#3a62b5")
    return Item("jumpers", "jumper_wires", 0.1 * p.mass.cables, "W01", tuple(shapes))


def channel_leads(p: Parameters, run: dict[str, Way]) -> list[Item]:
    """Three-wire leads of servo and speed controller; their plugs are in the board's sockets."""
    return [Item(name, bom, 0.02 * p.mass.cables, "W05",
                 tuple(bundle(free(run[cable]), 1.4, colour)))
            for name, bom, cable, colour in (("lead_servo", "servo", "W_SERVO", ORANGE),
                                             ("lead_esc", "esc", "W_ESC", WHITE))]


def lidar_lead(p: Parameters) -> Item:
    """From behind the lidar's pan along the plate into its adapter, between USB and standoff."""
    z = deck_top(p)
    x, y = p.base_holes.adapter_x[1], p.base_holes.adapter_y[1] - 4.5
    rear = p.lidar.rear_x - 8.6
    way = ((rear, 12.0, z + 14), (rear - 8, 26.0, z + 9), (x + 1.6, 36.0, z + 8),
           (x + 1.6, y, z + 8), (x - 2.8, y, z + 7.5))
    return Item("lidar_lead", "lidar_adapter", 0.05 * p.mass.cables, "S11",
                tuple(bundle(way, 1.2, BLACK)))


def battery_leads(p: Parameters, run: dict[str, Way]) -> Item:
    """T plugs above the plate, where a hand can part them."""
    pack, esc = run["W_PACK"], run["W_LIPO"]
    x, y, z = pack[-2]
    near = x - 2 * T_PLUG - 2
    shapes = [box(x - T_PLUG, x, y - 4, y + 4, z - 4, z + 4, RED),
              box(near, near + T_PLUG, y - 4, y + 4, z - 4, z + 4, RED),
              box(near + T_PLUG, x - T_PLUG, y - 3, y + 3, z - 3, z + 3, YELLOW)]
    shapes += bundle(free(pack), 2.4, RED)
    shapes += bundle(free(esc), 2.4, BLACK)
    ex, ey = p.base_windows.lead_x[0], p.base_windows.lead_y[0]
    shapes.append(box(ex - 8, ex - 3, ey - 1, ey - 0.6, -9, -1, YELLOW))
    return Item("battery_leads", "lipo_lead", 0.2 * p.mass.cables, "S14", tuple(shapes))


def fuse(p: Parameters) -> Item:
    """Holder of the blade fuse, upright behind the T plugs; yellow means 20 A."""
    x, z = fuse_front(p), deck_top(p)
    y = p.base_windows.lead_y[0] + 1.5
    shapes = (box(x - 10.4, x, y - 8.5, y + 8.5, z + 8.2, z + 29, BLACK),
              box(x - 7.7, x - 2.7, y - 7, y + 7, z + 29, z + 33, YELLOW))
    return Item("fuse", "lipo_fuse", 12.0, "S14", shapes)


def tie(x: float, y: float, half: float, low: float, high: float) -> list[Shape]:
    """Cable tie of 2.5 mm across the car over something `2 half` wide, its lock to the left."""
    return [box(x - 1.25, x + 1.25, y - half - 1, y + half + 1, high, high + 1, TIE),
            box(x - 1.25, x + 1.25, y - half - 1, y - half, low, high, TIE),
            box(x - 1.25, x + 1.25, y + half, y + half + 1, low, high, TIE),
            box(x - 2.2, x + 2.2, y + half + 1, y + half + 4, high - 1.5, high + 2, TIE)]


def ties(p: Parameters) -> list[Item]:
    """Two over the infrared module, before and behind its potentiometer; one over the Nano."""
    f, front = p.car.floor_z, module_pins(p)
    module = tie(front - 26, 0, 7.6, f, f + 1.7) + tie(front - 5, 0, 7.6, f, f + 1.7)
    w, m, z = p.base_windows, p.imu_nano, deck_top(p)
    x, y = sum(w.nano_x) / 2 + 10, sum(w.nano_y) / 2
    half = m.nano_width / 2 + m.nano_play + m.wall + 0.1
    nano = tie(x, y, half, z, z + m.wall_height - 1.4)
    return [Item("ir_ties", "cable_ties", 0.5, "S04", tuple(module)),
            Item("nano_tie", "cable_ties", 0.3, "S13", tuple(nano))]


def cables(p: Parameters) -> list[Item]:
    run = ways(p)
    return [*usb(p, run), lidar_lead(p), six_wire(p, run["W_BOARD"]), jumpers(p, run),
            *channel_leads(p, run), battery_leads(p, run), fuse(p), *ties(p)]
