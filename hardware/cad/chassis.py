"""Envelopes below the deck: chassis, wheels, expansion board, batteries, encoder."""

from __future__ import annotations

import math

from battery import battery
from bought import BLACK, BLUE, DARK, RED, SILVER, WHITE, Item
from parameters import Parameters
from shapes import Shape, Vector, box, cylinder, hull, prism, rim
from steering import linkage, servo

PLASTIC = "#4a4d52"

# mm; from the photo of the main gear, 50 teeth on 31.2 mm.
GEAR_MODULE = 0.6


def axle_z(p: Parameters) -> float:
    """Height of axles and main shaft, mm."""
    return p.car.ground_z + p.car.wheel_radius


def wheel(x: float, y: float, z: float, radius: float) -> list[Shape]:
    """Tyre, rim and five spokes."""
    out = 13.0 if y > 0 else -13.0
    shapes = [cylinder((x, y - 13, z), (x, y + 13, z), radius, BLACK, inner=radius - 7),
              cylinder((x, y - 11, z), (x, y + 11, z), radius - 7, SILVER, inner=radius - 9),
              cylinder((x, y + 0.1 * out, z), (x, y + 0.75 * out, z), 4.5, SILVER),
              cylinder((x, y + 0.75 * out, z), (x, y + 1.05 * out, z), 2.8, BLUE, sides=6)]
    for k in range(5):
        a = 2 * math.pi * k / 5
        reach = radius - 8.5
        shapes.append(cylinder((x, y + 0.55 * out, z),
                               (x + reach * math.cos(a), y + 0.55 * out,
                                z + reach * math.sin(a)), 1.9, SILVER, sides=12))
    return shapes


CAP_LOW = 0.68
"""Lower face of a shock's cap, share of the way from its lower to its upper end [photo]."""


def shock(p: Parameters, front: bool, side: int) -> tuple[tuple[float, float, float],
                                                          tuple[float, float, float]]:
    """Lower and upper end of a shock."""
    x = p.car.rear_axle_x + (p.car.wheelbase + 12 if front else -12)
    z = axle_z(p)
    return (x, side * 51.0, z - 5), (x, side * 31.0, -9.0)


def axle(p: Parameters, front: bool) -> list[Shape]:
    """Gearbox, arms, half shafts and tower of one axle; the rear gearbox is an item of its own."""
    x = p.car.rear_axle_x + (p.car.wheelbase if front else 0)
    z, s = axle_z(p), 1 if front else -1
    inner = x - 15 * s
    low, high = sorted((inner, x + 17 * s))
    shapes = [box(low, high, -16, 16, z - 13, z + 11, PLASTIC)] if front else []
    tower = sorted((x + 4.5 * s, x + 2 * s))
    shapes += [box(*tower, -36, 36, z + 11.5, z + 17, DARK)]
    for y in (-1, 1):
        span = sorted((y * 22.0, y * 36.0))
        shapes.append(box(*tower, *span, z + 17, -6, DARK))
        arm = sorted((y * 16.0, y * 60.0))
        shapes.append(box(x - 6, x + 6, *arm, z - 10, z - 6, PLASTIC))
        shapes.append(cylinder((x, y * 16, z), (x, y * 60, z), 2.2, SILVER, sides=16))
    return shapes


def front_wheels(p: Parameters) -> list[Item]:
    """Both, each by itself: they turn."""
    x = p.car.rear_axle_x + p.car.wheelbase
    return [Item(f"front_wheel_{name}", "kit", 0.03 * p.mass.chassis, "S01",
                 tuple(wheel(x, y * p.car.track / 2, axle_z(p), p.car.wheel_radius)))
            for name, y in (("left", 1), ("right", -1))]


def shocks(p: Parameters) -> Item:
    """Rod, spring and blue hexagonal cap of all four; the printed or brass ring sits between spring
    and cap."""
    shapes = []
    for front in (False, True):
        for side in (-1, 1):
            lower, upper = shock(p, front, side)

            def at(share: float, low: Vector = lower, high: Vector = upper) -> Vector:
                x, y, z = (a + share * (b - a) for a, b in zip(low, high, strict=True))
                return x, y, z

            cap = CAP_LOW
            shapes += [cylinder(at(cap), at(0.93), 6.6, "#2a86a8", sides=6),
                       cylinder(at(0.3), at(cap), 4.6, "#3a3d42", sides=24),
                       cylinder(lower, at(0.3), 1.6, SILVER, sides=16),
                       cylinder(at(0.93), at(1.0), 2.5, DARK, sides=16)]
            seat = cap - p.shock.length / math.dist(lower, upper) - 0.005
            low = 0.1
            for k in range(5):
                start = low + (seat - low) * k / 5
                shapes.append(cylinder(at(start), at(start + (seat - low) / 10), 6.0, DARK,
                                       inner=4.8))
    return Item("shocks", "kit", 0.05 * p.mass.chassis, "S06", tuple(shapes))


def rolling_chassis(p: Parameters) -> Item:
    """Tub, axles, rear wheels, shaft, motor, ESC."""
    c, z, f = p.car, axle_z(p), p.car.floor_z
    rear, front = c.rear_axle_x, c.rear_axle_x + c.wheelbase
    shapes = [prism([(rear - 20, -20), (rear + 28, -44), (front - 28, -44), (front + 22, -20),
                     (front + 22, 20), (front - 28, 44), (rear + 28, 44), (rear - 20, 20)],
                    f - 2, f, DARK),
              prism([(rear + 32, 44), (front - 34, 44), (front - 40, 74), (rear + 36, 74)],
                    f - 2, f, DARK),
              prism([(rear + 32, -44), (rear + 36, -68), (front - 40, -68), (front - 34, -44)],
                    f - 2, f, DARK)]
    shapes += axle(p, False) + axle(p, True)
    for side in (-1, 1):
        shapes += wheel(rear, side * c.track / 2, z, c.wheel_radius)
    gear = c.gear_x + c.gear_width / 2
    shapes += [cylinder((magnets_face(p) - p.hall.face_to_ring, 0, z), (front - 15, 0, z), 2,
                        SILVER, sides=24),
               cylinder((gear + 4, -17, z + 6.7), (gear + 35, -17, z + 6.7), 12, SILVER),
               cylinder((gear - 5, -17, z + 6.7), (gear + 4, -17, z + 6.7), 1.2, SILVER),
               box(28, 58, 14, 40, f, f + 22, RED)]
    shapes += [box(30 + 3 * i, 31.5 + 3 * i, 15, 39, f + 22, f + 26, SILVER) for i in range(9)]
    shapes += [cylinder((p.base_holes.clear_front_x, y, f),
                        (p.base_holes.clear_front_x, y, c.board_z - 1.6), 2.5, WHITE, sides=6)
               for y in p.base_holes.clear_front_y]
    return Item("chassis", "kit", 0.77 * p.mass.chassis, "S01", tuple(shapes))


def magnets_face(p: Parameters) -> float:
    """X of the magnet ring's face, flush with the magnets, mm."""
    return p.car.gear_x - p.car.gear_web / 2 - p.rings.magnet_floor - p.rings.magnet_depth


def rear_gearbox(p: Parameters) -> Item:
    """Box behind the main gear; the Hall holder sits on its front face around the boss."""
    x, z, face = p.car.rear_axle_x, axle_z(p), magnets_face(p) - p.hall.face_to_ring
    shapes = [box(x - 17, face, -16, 16, z - 13, z + 11, PLASTIC)]
    if p.hall.boss_length:
        shapes.append(cylinder((face, 0, z), (face + p.hall.boss_length, 0, z), p.hall.boss / 2,
                               PLASTIC, inner=2.1))
    return Item("rear_gearbox", "kit", 0.1 * p.mass.chassis, "S02", tuple(shapes))


def magnets(p: Parameters) -> Item:
    """Discs in the ring behind the gear, the same pole to the switch."""
    r, x, z = p.rings, magnets_face(p), axle_z(p)
    shapes = []
    for k in range(r.magnets):
        a = 2 * math.pi * k / r.magnets
        y, up = r.magnet_radius * math.cos(a), z - r.magnet_radius * math.sin(a)
        shapes.append(cylinder((x, y, up), (x + 1.0, y, up), r.magnet_diameter / 2, SILVER,
                               sides=24))
    return Item("magnets", "magnets", 0.1, "S03", tuple(shapes))


def main_gear(p: Parameters) -> Item:
    """Rim, web and hub; its mass is part of the chassis."""
    c, g, z = p.car, p.gear, axle_z(p)
    x, half, web = c.gear_x, c.gear_width / 2, c.gear_web / 2
    teeth = round(g.outer / GEAR_MODULE) - 2
    shapes = (rim((x - half, 0, z), (x + half, 0, z), g.outer / 2, g.recess / 2, teeth, DARK),
              cylinder((x - web, 0, z), (x + web, 0, z), g.recess / 2, BLACK, 4.0),
              cylinder((x - half, 0, z), (x + half, 0, z), g.hub / 2 - 0.05, DARK, 2.2))
    return Item("gear", "kit", 0.0, "S02", shapes)


def bumper(p: Parameters) -> Item:
    x, z = p.car.rear_axle_x + p.car.wheelbase + 24, axle_z(p)
    outline = hull([(x + 3, -52, 3), (x + 3, 52, 3), (x + 10, -40, 8), (x + 10, 40, 8)])
    return Item("bumper", "kit", p.mass.bumper, "S01",
                (prism(outline, z - 13, z + 5, "#26262a"),))


def four_cells(z: float) -> list[Shape]:
    """18650 cells in their holder: red sleeve and silver button at plus. Two and two the other way
    round [assumed: the print in the holder decides]."""
    shapes = []
    for y, plus in ((-30.0, 1), (-10.0, 1), (10.0, -1), (30.0, -1)):
        ends = (60.7, 123.8) if plus > 0 else (124.4, 61.3)
        band = ends[1] - plus * 12
        shapes += [cylinder((ends[0], y, z), (band, y, z), 9.25, "#3d7a4b"),
                   cylinder((band, y, z), (ends[1], y, z), 9.25, RED),
                   cylinder((ends[1], y, z), (ends[1] + plus * 1.2, y, z), 3.0, SILVER),
                   cylinder((ends[0] - plus * 0.6, y, z), (ends[0], y, z), 7.5, SILVER)]
    return shapes


def electronics(p: Parameters) -> list[Item]:
    """Expansion board with four cells below, infrared module, Hall switch."""
    c, f = p.car, p.car.floor_z
    top, z = c.board_z, axle_z(p)
    board = [box(0, 138, -40.5, 40.5, top - 1.6, top, "#17304f"),
             box(60, 76, -40, -28, top, top + 9, SILVER),
             box(20, 32, -39, -25, top, top + 6, WHITE),
             box(44, 66, 27, 38, top, top + 8, BLACK), box(82, 108, 5, 30, top, top + 3, BLACK)]
    cells = four_cells(top - 11.2)
    holder = [box(59.1, 59.9, -40, 40, top - 14, top - 1.6, BLACK),
              box(125.0, 125.4, -40, 40, top - 14, top - 1.6, BLACK)]
    slit = c.gear_x + c.gear_width / 2 + p.gate.to_gear
    start = slit + p.gate.depth
    module = [box(start + 1, start + 32, -7.5, 7.5, f, f + 1.6, BLUE),
              box(start + 18, start + 25, -3.5, 3.5, f + 1.6, f + 8, "#2d5fb3")]
    for y, colour in ((-3.2, BLACK), (3.2, WHITE)):
        module.append(cylinder((slit + 8, y, f + 4.6), (start + 4, y, f + 4.6), 2.5, colour))
    return [Item("expansion_board", "expansion_board", p.mass.expansion_board, "S07",
                 tuple(board + holder)),
            Item("cells", "cells", 4 * p.mass.cell, "S07", tuple(cells)),
            Item("ir_module", "ir_module", p.mass.ir_module, "S04", tuple(module)),
            hall_sensor(p, z)]


def hall_sensor(p: Parameters, z: float) -> Item:
    """Switch in its pocket, opposite the circle of the magnets."""
    h, r = p.hall, p.rings.magnet_radius
    x = magnets_face(p) - h.air_gap
    shapes = [box(x - h.sensor_z, x, r - h.sensor_y / 2, r + h.sensor_y / 2,
                  z - h.sensor_x / 2, z + h.sensor_x / 2, BLACK)]
    shapes += [box(x - 0.8, x - 0.3, r + h.sensor_y / 2, r + 14, z + k - 0.25, z + k + 0.25, SILVER)
               for k in (-1.27, 0, 1.27)]
    return Item("hall_sensor", "hall_sensor", 0.5, "S05", tuple(shapes))


def chassis_items(p: Parameters) -> list[Item]:
    return [rolling_chassis(p), shocks(p), rear_gearbox(p), main_gear(p), magnets(p), bumper(p),
            *electronics(p), servo(p), linkage(p), *front_wheels(p), *battery(p)]
