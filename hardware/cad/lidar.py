"""Stiff stand of the lidar: four pillars in place of loose ones, open in front for its motor."""

from __future__ import annotations

import build123d as bd
from geometry import Part, Z, drill, screw_bore
from layout import lidar_points
from parameters import Parameters

PILLAR = 9.0  # mm, outer diameter
FRAME = 3.0  # mm, thickness of the frame under the lidar


def rail(a: tuple[float, float], b: tuple[float, float]) -> bd.Part:
    """Straight bar with round ends, FRAME thick, on the bed."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = (dx * dx + dy * dy) ** 0.5
    plane = bd.Plane(origin=((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, 0), x_dir=(dx, dy, 0))
    bar = plane * bd.SlotCenterToCenter(length, PILLAR - 1.0)
    return bd.extrude(bar, amount=FRAME, dir=(0, 0, 1))


def lidar_mount(p: Parameters) -> Part:
    """Frame on the bed, pillars upright; turned over in the car. x, y as in the deck frame."""
    height = p.lidar.pillar
    front_left, front_right, rear_left, rear_right = lidar_points(p)
    body = rail(rear_left, rear_right) + rail(rear_left, front_left) + rail(rear_right, front_right)
    bores = []
    for x, y in lidar_points(p):
        body += bd.Pos(x, y, height / 2) * bd.Cylinder(PILLAR / 2, height)
        bores.append(screw_bore(p, "M3", (x, y, height / 2), Z, height, "lidar", p.lidar.slot))
    return Part("lidar_mount", drill(body, bores), tuple(bores), "printed", 1.8, "#d9822b")


def parts(p: Parameters) -> list[Part]:
    return [lidar_mount(p)]
