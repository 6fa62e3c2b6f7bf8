"""Where each part sits in the finished car, and what that adds up to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from bought import Item, deck_items, roof_low
from cables import cables
from chassis import CAP_LOW, axle_z, chassis_items, magnets_face, shock
from geometry import Matrix, frame
from parameters import Parameters
from shapes import body


@dataclass(frozen=True)
class Placement:
    """One made part in the car: matrix from its STL into the deck frame, step of the build,
    direction and length [mm] in which the exploded view moves it."""

    name: str
    part: str
    matrix: Matrix
    step: str
    lift: tuple[float, float, float]


def deck(p: Parameters) -> list[Placement]:
    """Plates and what is screwed to them."""
    t, roof = p.sheet.thickness, roof_low(p)
    c = p.camera
    slot_low = roof - p.sheet.slot_play / 2
    holders = [Placement(f"board_holder_{side}", "board_holder", frame((0, y, t)), "S08",
                         (-40, 0, 25)) for side, y in (("left", p.back.hole_half),
                                                      ("right", -p.back.hole_half))]
    holders += [Placement(f"small_board_holder_{side}", "small_board_holder",
                          frame((0, y, roof), y=(0.0, -1.0, 0.0)), "S12", (-40, 0, 110))
                for side, y in (("left", p.back.hole_half), ("right", -p.back.hole_half))]
    return [
        Placement("base_plate", "base_plate", frame((0, 0, 0)), "S08", (0, 0, 0)),
        Placement("lidar_mount", "lidar_mount",
                  frame((0, 0, t + p.lidar.pillar), y=(0.0, -1.0, 0.0)), "S11", (60, 0, 20)),
        Placement("nano_imu_mount", "nano_imu_mount", frame((0, 0, t)), "S08", (0, 0, 22)),
        Placement("upper_plate", "upper_plate", frame((0, 0, roof)), "S12", (0, 0, 140)),
        Placement("camera_bracket", "camera_bracket",
                  frame((p.upper.outline_left[-2] - c.depth, c.width / 2, slot_low - c.jaw),
                        y=(0.0, 0.0, 1.0)), "S12", (55, 0, 150)),
        Placement("cutoff_holder", "cutoff_holder",
                  frame((p.upper.cutoff_x, p.upper.cutoff_y, roof + t)), "W09", (0, 0, 175)),
        *holders,
        Placement("back_plate", "back_plate", frame((0, 0, 0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
                  "S12", (-90, 0, 70)),
    ]


def encoder(p: Parameters) -> list[Placement]:
    """Rings on the main gear, gate before it, Hall holder behind it."""
    c, z = p.car, axle_z(p)
    left, up = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    web = c.gear_web / 2
    slit = c.gear_x + c.gear_width / 2 + p.gate.to_gear
    return [
        Placement("striped_ring", "striped_ring", frame((c.gear_x + web, 0, z), left, up), "S03",
                  (22, 0, -55)),
        Placement("magnet_ring", "magnet_ring",
                  frame((c.gear_x - web, 0, z), left, (0.0, 0.0, -1.0)), "S03", (-22, 0, -55)),
        Placement("sensor_gate", "sensor_gate",
                  frame((slit + p.gate.depth, p.gate.slit_x, c.floor_z + p.gate.height),
                        (0.0, -1.0, 0.0), (-1.0, 0.0, 0.0)), "S04", (48, 0, -55)),
        Placement("hall_holder", "hall_holder",
                  frame((magnets_face(p) - p.hall.face_to_ring, 0, z), left, up), "S05",
                  (-45, 0, -55)),
    ]


def shock_rings(p: Parameters) -> list[Placement]:
    """One around each shock, under its upper cap."""
    found = []
    for end in ("rear", "front"):
        for side, sign in (("left", 1), ("right", -1)):
            lower, upper = (np.array(q) for q in shock(p, end == "front", sign))
            along = (upper - lower) / np.linalg.norm(upper - lower)
            x = np.array([1.0, 0.0, 0.0])
            start = lower + CAP_LOW * (upper - lower) - along * p.shock.length
            found.append(Placement(f"shock_ring_{end}_{side}", "shock_ring",
                                   frame(tuple(start), tuple(x), tuple(np.cross(along, x))),
                                   "S06", (0, 35 * sign, -60)))
    return found


def placements(p: Parameters) -> list[Placement]:
    return deck(p) + encoder(p) + shock_rings(p)


def items(p: Parameters) -> list[Item]:
    return chassis_items(p) + deck_items(p) + cables(p)


def item_mesh(item: Item) -> list[trimesh.Trimesh]:
    return [body(shape) for shape in item.shapes]


def balance(weighed: list[tuple[float, list[trimesh.Trimesh]]]) -> dict[str, Any]:
    """Mass [g], centre of mass [mm] and yaw inertia about it [kg m2] of (mass, bodies)."""
    total, moment, about_z = 0.0, np.zeros(3), 0.0
    for mass, meshes in weighed:
        volume = sum(m.volume for m in meshes)
        for mesh in meshes:
            share = mass * mesh.volume / volume
            centre = mesh.center_mass
            total += share
            moment += share * centre
            about_z += share * (mesh.moment_inertia[2, 2] / mesh.volume
                                + centre[0] ** 2 + centre[1] ** 2)
    centre = moment / total
    inertia = (about_z - total * (centre[0] ** 2 + centre[1] ** 2)) * 1e-9
    return {"mass_g": round(total, 2), "centre_mm": [round(float(v), 2) for v in centre],
            "yaw_inertia_kg_m2": round(float(inertia), 6)}
