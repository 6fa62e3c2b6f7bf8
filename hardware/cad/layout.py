"""What is cut from sheet: outline, holes, windows and marks of the plates and the striped ring.

Plain numbers without a CAD kernel: solids, drawings and checks all read these tables. Base and
upper plate are in the deck frame seen from above (X forward, Y left, mm); the back plate is
seen from behind with u to the right = -Y and v up = Z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from outlines import Outline, polygon, rectangle
from parameters import Parameters

ISO_273_FINE = {"M1.6": 1.7, "M2": 2.2, "M2.5": 2.7, "M3": 3.2}  # mm, clearance holes


@dataclass(frozen=True)
class Hole:
    """A round hole of a sheet; `screw` is empty where no screw passes."""

    x: float
    y: float
    diameter: float
    screw: str
    use: str
    parameter: str


@dataclass(frozen=True)
class Cut:
    """A window or slot of a sheet."""

    outline: Outline
    use: str
    parameter: str


@dataclass(frozen=True)
class Sheet:
    """One part cut from a sheet of `thickness` mm; marks are engraved, not cut."""

    name: str
    thickness: float
    outline: Outline
    holes: tuple[Hole, ...]
    cuts: tuple[Cut, ...] = ()
    marks: tuple[Outline, ...] = ()


def screw_holes(screw: str, points: list[tuple[float, float]], use: str,
                parameter: str) -> list[Hole]:
    return [Hole(x, y, ISO_273_FINE[screw], screw, use, parameter) for x, y in points]


def plain_holes(diameter: float, points: list[tuple[float, float]], use: str,
                parameter: str) -> list[Hole]:
    return [Hole(x, y, diameter, "", use, parameter) for x, y in points]


def grid(xs: tuple[float, ...], ys: tuple[float, ...]) -> list[tuple[float, float]]:
    return [(x, y) for x in xs for y in ys]


def box(x0: float, x1: float, y0: float, y1: float, radius: float = 1.0) -> Outline:
    return rectangle((x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0, radius=radius)


def arrow(x: float, y: float) -> Outline:
    """Mark that points forward, 12 mm long: a plate laid upside down or backwards shows."""
    return polygon([(x - 6, y - 1.5), (x, y - 1.5), (x, y - 4), (x + 6, y), (x, y + 4),
                    (x, y + 1.5), (x - 6, y + 1.5)])


def lidar_points(p: Parameters) -> list[tuple[float, float]]:
    lidar = p.lidar
    return [(lidar.front_x, lidar.front_half), (lidar.front_x, -lidar.front_half),
            (lidar.rear_x, lidar.rear_half), (lidar.rear_x, -lidar.rear_half)]


def imu_points(p: Parameters) -> list[tuple[float, float]]:
    h = p.base_holes
    dx, dy = h.imu_pitch_x / 2, h.imu_pitch_y / 2
    return [(h.imu_x + sx * dx, sy * dy) for sx in (-1, 1) for sy in (-1, 1)]


def cutoff_points(p: Parameters) -> list[tuple[float, float]]:
    """Both screws of the holder of the cut-off, along the car beside its board."""
    reach = p.cutoff.board_length / 2 + p.cutoff.wall + 5.0
    return [(p.upper.cutoff_x - reach, p.upper.cutoff_y),
            (p.upper.cutoff_x + reach, p.upper.cutoff_y)]


def base_outline(p: Parameters) -> Outline:
    b = p.base
    # A centre too far ahead or a small radius gives no arc: `checks` refuses it beforehand.
    half = math.sqrt(max(b.arc_radius**2 - (b.arc_x - b.length) ** 2, 0.0))
    bulge = -math.tan(math.atan2(half, b.arc_x - b.length) / 2)  # clockwise, into the plate
    w, f = b.half_width, b.half_width_front
    return ((0, -w, 0), (b.length_side, -w, 0), (b.length, -f, 0), (b.length, -half, bulge),
            (b.length, half, 0), (b.length, f, 0), (b.length_side, w, 0), (0, w, 0))


def base_holes(p: Parameters) -> list[Hole]:
    h = p.base_holes
    sides = (h.bracket_half, -h.bracket_half)
    return [
        *screw_holes("M2.5", grid(p.jetson.x, p.jetson.y), "jetson", "jetson.x, jetson.y"),
        *screw_holes("M2.5", grid(p.board_posts.x, p.board_posts.y), "expansion_board",
                     "board_posts.x, board_posts.y"),
        *screw_holes("M3", lidar_points(p), "lidar",
                     "lidar.front_x, front_half, rear_x, rear_half"),
        *screw_holes("M3", grid((h.bracket_x,), sides), "board_holder",
                     "base_holes.bracket_x, bracket_half"),
        *screw_holes("M3", grid((h.mount_x,), h.mount_y), "nano_imu_mount",
                     "base_holes.mount_x, mount_y"),
        *screw_holes("M2.5", imu_points(p), "imu", "base_holes.imu_x, imu_pitch_x, imu_pitch_y"),
        *screw_holes("M2.5", grid(h.adapter_x, h.adapter_y), "lidar_adapter",
                     "base_holes.adapter_x, adapter_y"),
        *plain_holes(h.antenna_diameter, grid((h.antenna_x,), h.antenna_y), "antennas",
                     "base_holes.antenna_x, antenna_y, antenna_diameter"),
        *plain_holes(h.clear_front_diameter, grid((h.clear_front_x,), h.clear_front_y),
                     "board_screws", "base_holes.clear_front_x, clear_front_y"),
        *plain_holes(h.clear_rear_diameter,
                     grid((h.clear_rear_x,), (h.clear_rear_half, -h.clear_rear_half)),
                     "board_screws", "base_holes.clear_rear_x, clear_rear_half"),
        *plain_holes(h.cable_diameter, list(zip(h.cable_x, h.cable_y, strict=True)), "cables",
                     "base_holes.cable_x, cable_y, cable_diameter"),
    ]


def base_plate(p: Parameters) -> Sheet:
    w = p.base_windows
    half = w.nano_width / 2
    cuts = [
        Cut(box(*w.fan, radius=3.0), "fan", "base_windows.fan"),
        Cut(box(*w.six_wire), "cable_6pin", "base_windows.six_wire"),
        *(Cut(box(*w.nano_x, y - half, y + half, radius=0.0), "nano",
              "base_windows.nano_x, nano_y, nano_width") for y in w.nano_y),
        *(Cut(rectangle(x, y, w.lead_length, w.lead_width, a, 1.0), "leads",
              "base_windows.lead_x, lead_y")
          for x, y, a in zip(w.lead_x, w.lead_y, w.lead_angle, strict=True)),
    ]
    return Sheet("base_plate", p.sheet.thickness, base_outline(p), tuple(base_holes(p)),
                 tuple(cuts), (arrow(28.0, 56.0),))


def upper_plate(p: Parameters) -> Sheet:
    u, h = p.upper, p.base_holes
    flat = list(u.outline_left) + list(u.outline_right)
    points = list(zip(flat[::2], flat[1::2], strict=True))
    points = [(0.0, u.outline_left[1]), *points[1:]]
    holes = [
        *screw_holes("M2.5", grid(p.jetson.x, p.jetson.y), "jetson", "jetson.x, jetson.y"),
        *screw_holes("M3", grid((u.bracket_x,), (h.bracket_half, -h.bracket_half)),
                     "small_board_holder", "upper.bracket_x, base_holes.bracket_half"),
        *screw_holes("M3", grid((u.camera_x,), (u.camera_half, -u.camera_half)),
                     "camera_bracket", "upper.camera_x, camera_half"),
        *screw_holes("M3", cutoff_points(p), "cutoff_holder", "upper.cutoff_x, cutoff_y"),
        *plain_holes(h.antenna_diameter, grid((h.antenna_x,), u.antenna_y), "antennas",
                     "base_holes.antenna_x, upper.antenna_y"),
    ]
    return Sheet("upper_plate", p.sheet.thickness, polygon(points[::-1]), tuple(holes), (),
                 (arrow(72.0, 30.0),))


def back_plate(p: Parameters) -> Sheet:
    b = p.back
    w, narrow = p.base.half_width, p.base.half_width - b.corner
    bulge = -math.tan(math.pi / 8)  # a quarter, clockwise: hollow corners
    top, low = b.height, b.height - b.notch_depth
    notches = [(u + s * b.notch_width / 2, v) for u in sorted(b.notch_u, reverse=True)
               for s, v in ((1, top), (1, low), (-1, low), (-1, top))]
    outline = ((-w, 0.0, 0.0), (w, 0.0, 0.0), (w, b.shoulder, bulge),
               (narrow, b.shoulder + b.corner, 0.0), (narrow, top, 0.0),
               *((u, v, 0.0) for u, v in notches), (-narrow, top, 0.0),
               (-narrow, b.shoulder + b.corner, bulge), (-w, b.shoulder, 0.0))
    holes = screw_holes("M3", grid((b.hole_half, -b.hole_half), b.hole_v),
                        "board_holder, small_board_holder", "back.hole_half, hole_v")
    cuts = (Cut(box(*b.window, radius=3.0), "jetson ports", "back.window"),)
    return Sheet("back_plate", p.sheet.thickness, outline, tuple(holes), cuts)


def striped_ring(p: Parameters) -> Sheet:
    r = p.rings
    half = math.pi / (2 * r.teeth)  # tooth = gap = 360 / (2 x teeth) deg
    k = math.tan(half / 2)
    points: list[tuple[float, float, float]] = []
    for tooth in range(r.teeth):
        a = 2 * math.pi * tooth / r.teeth
        for radius, begin, bulge in ((r.tip, a - half, k), (r.tip, a + half, 0.0),
                                     (r.root, a + half, k), (r.root, a + 3 * half, 0.0)):
            points.append((radius * math.cos(begin), radius * math.sin(begin), bulge))
    bore = Hole(0.0, 0.0, p.gear.hub + p.gear.hub_play, "", "hub", "gear.hub, hub_play")
    return Sheet("striped_ring", p.sheet.ring_thickness, tuple(points), (bore,))


def sheets(p: Parameters) -> list[Sheet]:
    """Every part cut from sheet."""
    return [base_plate(p), upper_plate(p), back_plate(p), striped_ring(p)]
