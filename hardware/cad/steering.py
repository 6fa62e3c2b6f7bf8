"""Servo on its side, horn, turnbuckle, cranks and front wheels, at any angle of the steering."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import trimesh
from bought import BLACK, SILVER, Item
from collisions import TOUCH, Bodies, shared
from parameters import Parameters
from shapes import Shape, Vector, body, box, cylinder

HORN = "#b3261e"
CRANK, ARM = 19.0, 12.0
"""mm from the pivot of a crank to turnbuckle and to the rods of the wheels [assumed]."""
LEAN = math.radians(20.0)
"""Of the horn to the rear with the wheels straight [photo]."""
POSES = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Shares of the throw that are tried."""


def axle_height(p: Parameters) -> float:
    return p.car.ground_z + p.car.wheel_radius


def hub(p: Parameters) -> Vector:
    """Output shaft where the horn sits, mm."""
    s = p.steering
    return s.servo_x, s.servo_top_y - 4.5, p.car.floor_z + s.servo_width / 2


def servo(p: Parameters) -> Item:
    """Lies on its side: bottom near the middle line, shaft to the right at the rear end."""
    s, f = p.steering, p.car.floor_z
    x0 = s.servo_x - s.servo_width / 2
    x1, top, bottom = x0 + s.servo_length, s.servo_top_y, s.servo_top_y + s.servo_depth
    z1 = f + s.servo_width
    flange = bottom - 27.2
    shapes = [box(x0, x1, top, bottom, f, z1, BLACK),
              box(x0 - 6.7, x1 + 6.7, flange - 1.2, flange + 1.2, f, z1, BLACK),
              cylinder((s.servo_x, top, f + s.servo_width / 2), hub(p), 2.9, SILVER)]
    return Item("servo", "servo", p.mass.servo, "S06", tuple(shapes))


def link_end(p: Parameters, angle: float) -> Vector:
    """Ball at the end of the horn; `angle` [rad] is positive to the left."""
    x, y, z = hub(p)
    a = LEAN + angle
    return x - p.steering.horn * math.sin(a), y - 3.0, z + p.steering.horn * math.cos(a)


def crank_point(p: Parameters, side: int, reach: float, towards: float, angle: float) -> Vector:
    """Point of a crank, `reach` from its pivot in the direction `towards` [rad] when straight."""
    s, z = p.steering, link_end(p, 0.0)[2]
    a = towards + angle
    return (s.crank_x + reach * math.cos(a), side * s.crank_y + reach * math.sin(a), z)


def moving(p: Parameters, angle: float) -> list[Shape]:
    """Horn, turnbuckle, both cranks and the rods between them, at an angle of the steering."""
    x, y, z = hub(p)
    end = link_end(p, angle)
    right = crank_point(p, -1, CRANK, -math.pi / 2, angle)
    pivots = [(p.steering.crank_x, side * p.steering.crank_y) for side in (-1, 1)]
    shapes = [cylinder((x, y, z), (x, y - 3, z), 4.5, HORN),
              cylinder((x, y - 2.7, z), (end[0], y - 2.7, end[2]), 2.6, HORN, sides=8),
              cylinder(end, right, 1.6, SILVER, sides=16),
              cylinder(right, (*pivots[0], right[2]), 2.2, BLACK, sides=16)]
    heads = []
    for side, (px, py) in zip((-1, 1), pivots, strict=True):
        ax, ay, az = crank_point(p, side, ARM, 0.0, angle)
        ahead = (ax, ay, az + 2.0)  # over the front gearbox
        shapes += [cylinder((px, py, p.car.floor_z), (px, py, end[2] + 3), 2.5, BLACK, sides=16),
                   cylinder((px, py, az + 2.0), ahead, 2.0, BLACK, sides=16),
                   cylinder(ahead, (ax, ay + side * 10, az - 5), 1.4, SILVER,
                            sides=16)]
        heads.append(ahead)
    shapes.append(cylinder(heads[0], heads[1], 1.4, SILVER, sides=16))
    return shapes


def linkage(p: Parameters) -> Item:
    return Item("linkage", "servo", 0.02 * p.mass.chassis, "S06", tuple(moving(p, 0.0)))


def turned_wheels(p: Parameters, front: Bodies, angle: float) -> Bodies:
    """Front wheels turned about their kingpins."""
    x, found = p.car.rear_axle_x + p.car.wheelbase, {}
    for name, meshes in front.items():
        y = math.copysign(p.steering.kingpin_y, meshes[0].bounds.mean(axis=0)[1])
        turn = trimesh.transformations.rotation_matrix(angle, [0, 0, 1], [x, y, 0])
        found[name] = [m.copy().apply_transform(turn) for m in meshes]
    return found


def sweep(p: Parameters, bodies: Bodies,
          poses: tuple[float, ...] = POSES) -> Iterator[str]:
    """Whatever the steering meets anywhere between its stops, in words."""
    front = {n: b for n, b in bodies.items() if n.startswith("front_wheel")}
    still = {n: b for n, b in bodies.items() if n not in front and n not in ("linkage", "servo")}
    pivots = {"chassis"}  # the cranks stand on its floor
    for share in poses:
        angle = math.radians(share * p.steering.throw)
        parts = {"linkage": [body(s) for s in moving(p, angle)], **turned_wheels(p, front, angle)}
        for name, meshes in parts.items():
            for other, others in still.items():
                if other in pivots and name == "linkage":
                    continue
                if sum(shared(a, b) for a in meshes for b in others) > TOUCH:
                    yield f"steering at {math.degrees(angle):+.0f} deg: {name} meets {other}"
        wheels = [m for n in front for m in parts[n]]
        if sum(shared(a, b) for a in parts["linkage"] for b in wheels) > TOUCH:
            yield f"steering at {math.degrees(angle):+.0f} deg: linkage meets a front wheel"


def reach_of_horn(p: Parameters) -> tuple[float, float]:
    """Rearmost and foremost X of the end of the horn over the throw, mm."""
    ends = [link_end(p, math.radians(s * p.steering.throw))[0] for s in np.linspace(-1, 1, 21)]
    return min(ends), max(ends)
