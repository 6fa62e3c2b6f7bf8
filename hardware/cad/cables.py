"""Plugs and bundles of wire as solids at true scale: where each lead runs, and what it must pass.

Ways are those of the photographs where they show them, else the shortest that keeps clear of
wheels, lidar and shaft [assumed]. Radii: 2.2 mm USB, 1.8 mm a bundle of jumper wires.
"""

from __future__ import annotations

from itertools import pairwise

from bought import BLACK, BLUE, RED, Item, deck_top
from parameters import Parameters
from shapes import Shape, Vector, box, cylinder

YELLOW, ORANGE = "#d8b23a", "#d9822b"
TIE = "#e8e4d8"
JUMPER = 14.0
"""Length of the socket of a jumper wire, mm [data sheet]."""


def bundle(points: list[Vector], radius: float, colour: str) -> list[Shape]:
    """Straight pieces from point to point."""
    return [cylinder(a, b, radius, colour, sides=12)
            for a, b in pairwise(points)]


def usb(p: Parameters) -> list[Item]:
    """Nano and lidar adapter to the rear of the Jetson: round the back plate and through it."""
    w, z = p.base_windows, deck_top(p)
    x, y = sum(w.nano_x) / 2 + p.imu_nano.nano_length / 2 + 2.6, sum(w.nano_y) / 2
    port = deck_top(p) + p.stack.standoff_lower - 5.0
    middle = sum(p.jetson.y) / 2
    side, back = -p.base.half_width - 5, -14.0
    right, left = middle - 9, middle + 7
    nano = [box(x, x + 20, y - 5.5, y + 5.5, z + 1.0, z + 8.0, BLUE),
            box(-22, 14.9, right - 6.5, right + 6.5, port - 3.5, port + 3.5, BLUE),
            *bundle([(x + 20, y, z + 4.5), (x + 34, y - 2, z + 6), (x + 34, y - 12, z + 18),
                     (x - 10, side, 34), (back, side, 34), (-42, -50, port), (-42, right, port),
                     (-22, right, port)], 2.2, BLUE)]
    a, b = p.base_holes.adapter_x, p.base_holes.adapter_y
    ax, ay = sum(a) / 2, b[0] - 3.1
    lidar = [box(ax - 5.5, ax + 5.5, ay - 20, ay, z + 4.2, z + 10.2, BLACK),
             box(-22, 14.9, left - 6.5, left + 6.5, port - 3.5, port + 3.5, BLACK),
             *bundle([(ax, ay - 20, z + 7), (ax - 18, 14, z + 12), (20, 18, 30), (6, 29, 36),
                      (-8, 29, 38.5), (-36, 22, port), (-36, left, port), (-22, left, port)],
                     2.2, BLACK)]
    return [Item("usb_nano", "usb_mini", 0.2 * p.mass.cables, "W03", tuple(nano)),
            Item("usb_lidar", "usb_micro", 0.15 * p.mass.cables, "W03", tuple(lidar))]


def six_wire(p: Parameters) -> Item:
    """Expansion board through the plate's window to pins 1 to 6 of the Jetson's header."""
    x, y = sum(p.base_windows.six_wire[:2]) / 2, sum(p.base_windows.six_wire[2:]) / 2
    low = deck_top(p) + p.stack.standoff_lower - 8.6 - JUMPER
    head = sum(p.jetson.y) / 2 + 47.5
    shapes = [box(38.6, 46.2, head - 2.5, head + 2.5, low, low + JUMPER, BLACK),
              *bundle([(x, y, p.car.board_z + 6.2), (x, y, 12), (25, 54, 19), (42.4, 54, 23),
                       (42.4, head, low)], 1.8, ORANGE)]
    return Item("cable_6pin", "cable_6pin", 0.05 * p.mass.cables, "W04", tuple(shapes))


def jumpers(p: Parameters) -> Item:
    """Sockets below the Nano; the infrared module's wires come up before the expansion board, the
    IMU's down through the round hole."""
    w, z = p.base_windows, deck_top(p)
    x, y = sum(w.nano_x) / 2, sum(w.nano_y) / 2
    pins = ((-7.62, (0, 3, 4, 8)), (7.62, (4, 7, 8, 11)))
    shapes = [box(x - 17.78 + 2.54 * n - 1.2, x - 17.78 + 2.54 * n + 1.2, y + s - 1.2, y + s + 1.2,
                  z - 2.7 - JUMPER, z - 2.7, BLACK) for s, row in pins for n in row]
    low, board = z - 2.7 - JUMPER, 141.6
    pin = module_pins(p)
    shapes += [box(pin + 0.2, pin + JUMPER, k * 2.54 - 1.2, k * 2.54 + 1.2, p.car.floor_z + 2.2,
                   p.car.floor_z + 4.6, BLACK) for k in (-1, 0, 1)]
    front = [(pin + JUMPER, 0.0, p.car.floor_z + 3.4), (118, -7.5, p.car.floor_z + 3),
             (board, -12, p.car.floor_z + 6), (board, -12, -6.0), (board, -44.5, -6.0),
             (x + 24, -44.5, -7.0), (x + 8, y + 7.62, low)]
    shapes += bundle(front, 1.8, "#d39a1e")  # type: ignore[arg-type]
    cx, cy = p.base_holes.cable_x[0], p.base_holes.cable_y[0]
    imu = [(p.base_holes.imu_x + 9, -11.0, z + 6.2), (p.base_holes.imu_x + 9, -20, z + 10),
           (cx, cy, z + 5), (cx, cy, -5.0), (x, y + 7.62 + 3, low - 1), (x - 2, y + 7.62, low)]
    shapes += bundle(imu, 1.6, "#3a62b5")  # type: ignore[arg-type]
    return Item("jumpers", "jumper_wires", 0.1 * p.mass.cables, "W01", tuple(shapes))


def lidar_lead(p: Parameters) -> Item:
    """From behind the lidar's pan along the plate into its adapter, between USB and standoff."""
    z = deck_top(p)
    x, y = p.base_holes.adapter_x[1], p.base_holes.adapter_y[1] - 4.5
    rear = p.lidar.rear_x - 8.6
    way = [(rear, 12.0, z + 14), (rear - 8, 26.0, z + 9), (x + 1.6, 36.0, z + 8),
           (x + 1.6, y, z + 8), (x - 2.8, y, z + 7.5)]
    return Item("lidar_lead", "lidar_adapter", 0.05 * p.mass.cables, "S11",
                tuple(bundle(way, 1.2, BLACK)))


def module_pins(p: Parameters) -> float:
    """X of the ends of the infrared module's pins, mm."""
    c = p.car
    return c.gear_x + c.gear_width / 2 + p.gate.to_gear + p.gate.depth + 32.0


def battery_leads(p: Parameters) -> Item:
    """Pack and ESC up through their slots; T plugs above the plate, where a hand can part them."""
    w, z = p.base_windows, deck_top(p)
    (ex, lx), (ey, ly) = w.lead_x, w.lead_y
    end, top = 69.5 + p.battery.length / 2, z + 16.5
    shapes = [box(68, 84, 50, 58, top - 4, top + 4, RED),
              box(50, 66, 50, 58, top - 4, top + 4, RED),
              box(66, 68, 51, 57, top - 3, top + 3, YELLOW)]
    low = p.car.floor_z + 7
    shapes += bundle([(end + 0.2, ly + 13, low), (end + 9, ly + 13, low), (end + 13, ly + 11, -17),
                      (lx, ly, -8), (lx, ly, z + 6), (lx - 8, 54, top), (84, 54, top)], 2.4, RED)
    esc = p.car.floor_z + 16
    shapes += bundle([(43, 40.3, esc), (43, 44, esc), (ex, ey, -10), (ex, ey, z + 7),
                      (ex - 3, 54, top), (50, 54, top)], 2.4, BLACK)
    shapes.append(box(ex - 8, ex - 3, ey - 1, ey - 0.6, -9, -1, YELLOW))
    return Item("battery_leads", "lipo_lead", 0.2 * p.mass.cables, "S14", tuple(shapes))


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
    return [*usb(p), lidar_lead(p), six_wire(p), jumpers(p), battery_leads(p),
            *ties(p)]
