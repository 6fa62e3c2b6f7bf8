"""Rendered pictures: every part, the exploded assembly, the finished car.

Everything is drawn from `built.json` and the STL files.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
import screws  # beside the folder: fasteners.py puts it on the path
import steps
import trimesh
from fasteners import fasteners
from inserts import INSERTS, file
from legends import LEGENDS
from pointing import Shown, astray
from scene import MARK, Thing, add, look, save, stage
from shapes import body, cylinder

CLEAR = "base_plate", "upper_plate", "back_plate"
VIEWS = {"camera_bracket": (1.2, 0.9, 0.9), "sensor_gate": (-0.7, -1.4, 1.3),
         "hall_holder": (0.9, -1.3, 1.1), "nano_imu_mount": (-0.6, -1.0, 1.6),
         "board_holder": (1.2, -1.1, 0.9), "fit_coupon": (0.3, -0.8, 1.6),
         "small_board_holder": (1.2, -1.1, 0.9)}


def part_picture(name: str, row: dict[str, Any], stl: Path, path: Path) -> None:
    """A part as it lies on the printer's bed or the cutter's table."""
    scene = stage((1500, 1200))
    mesh = trimesh.load_mesh(stl / f"{name}.stl")
    add(scene, mesh, row["colour"] if name != "striped_ring" else "#c9ccc6", width=2.5)
    for mark in row["marks"]:
        points = [(x, y, mesh.bounds[1][2] + 0.05) for x, y, _ in [*mark, mark[0]]]
        scene.add_mesh(pv.MultipleLines(np.array(points)), color=MARK, line_width=3)
    default = (-1.0, -1.2, 1.5) if row["process"] == "printed" else (-0.25, -0.6, 2.4)
    look(scene, VIEWS.get(name, default))
    save(scene, path)


BELOW = ("chassis", "shocks", "rear_gearbox", "bumper", "servo", "cells", "lipo", "expansion_board",
         "board_posts", "antennas", "shock_ring", "front_wheel", "linkage", "battery", "usb_",
         "cable_6pin", "jumpers", "lidar_lead", "lead_", "fuse", "ir_ties", "nano_tie")
ITEM_SHIFT = {"jetson": (0, 0, 85), "lidar": (95, 0, 30), "nano": (0, -20, 45),
              "imu": (0, 0, 45), "camera": (100, 0, 160), "lidar_adapter": (0, 40, 15),
              "cutoff_board": (0, 0, 200), "standoffs_lower": (0, 0, 40),
              "standoffs_upper": (0, 0, 115), "hall_sensor": (-45, 0, -55),
              "magnets": (-22, 0, -55), "gear": (0, 0, -55),
              "ir_module": (75, 0, -55)}


def things(report: dict[str, Any], stl: Path) -> list[Thing]:
    """Every body of the car, in its place; a screw of row n of screws.csv is "screw n head" and so
    on."""
    found = [Thing(item["name"], item["step"], body(shape), shape["colour"], False,
                   ITEM_SHIFT.get(item["name"], (0.0, 0.0, 0.0)))
             for item in report["items"] for shape in item["shapes"]]
    for q in report["placements"]:
        mesh = trimesh.load_mesh(stl / f"{q['part']}.stl")
        mesh.apply_transform(np.array(q["matrix"]))
        found.append(Thing(q["name"], q["step"], mesh, report["parts"][q["part"]]["colour"],
                           q["part"] in CLEAR, tuple(q["lift_mm"])))
        found += [Thing(q["name"], q["step"], line, MARK, False, tuple(q["lift_mm"]))
                  for line in mark_lines(report["parts"][q["part"]], np.array(q["matrix"]))]
    rows = screws.load()
    for f in fasteners(report, rows):
        found += [Thing(f"screw {rows.index(f.row)} {kind}", f.row.step, body(shape),
                        shape["colour"])
                  for kind, shape in f.pieces.items()]
    return found


def mark_lines(row: dict[str, Any], matrix: np.ndarray) -> list[trimesh.Trimesh]:
    """Engraved marks of a part as thin red rods on its upper face, in the car."""
    top = row["box_mm"][1][2]
    lines = []
    for mark in row["marks"]:
        corners = [(x, y, top) for x, y, _ in mark]
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            line = body(cylinder(start, end, 0.5, sides=16))
            line.apply_transform(matrix)
            lines.append(line)
    return lines


def exploded(every: list[Thing], path: Path) -> list[str]:
    """Exploded view of deck and encoder, without the chassis; returns what its labels miss."""
    scene, drawn = stage((1900, 1900)), list[Shown]()
    for thing in every:
        if thing.name.startswith((*BELOW, "screw")):
            continue
        mesh = thing.mesh.copy()
        mesh.apply_translation(thing.shift)
        add(scene, mesh, thing.colour, 0.45 if thing.clear else 1.0)
        drawn.append(Shown(thing.name, mesh, thing.clear))
    view = 1.25, 1.0, 0.8
    look(scene, view)
    save(scene, path, LEGENDS["exploded"], drawn)
    return [f"{path.name}: {said}" for said in astray(LEGENDS["exploded"], drawn, view)]


def shadow(scene: pv.Plotter, every: list[Thing]) -> None:
    """Soft dark patch on the floor below the car."""
    low = min(t.mesh.bounds[0][2] for t in every)
    box = np.array([t.mesh.bounds for t in every])
    (x0, y0, _), (x1, y1, _) = box[:, 0].min(axis=0), box[:, 1].max(axis=0)
    soft, n = 45.0, 90
    xs, ys = np.linspace(x0 - soft, x1 + soft, n), np.linspace(y0 - soft, y1 + soft, n)
    gx, gy = np.meshgrid(xs, ys, indexing="ij")
    away = np.hypot(np.maximum(np.maximum(x0 + 15 - gx, gx - x1 + 15), 0),
                    np.maximum(np.maximum(y0 + 15 - gy, gy - y1 + 15), 0))
    floor = pv.StructuredGrid(gx, gy, np.full_like(gx, low - 0.2))
    alpha = 90 * np.clip(1 - away / soft, 0, 1) ** 2
    colours = np.zeros((n * n, 4), dtype=np.uint8)
    colours[:, 3] = alpha.ravel(order="F")
    scene.add_mesh(floor, scalars=colours, rgba=True, lighting=False)


def car(every: list[Thing], path: Path, direction: tuple[float, float, float]) -> None:
    """The finished car on its wheels."""
    scene = stage((1700, 1500))
    shadow(scene, every)
    for thing in every:
        add(scene, thing.mesh, thing.colour, 0.42 if thing.clear else 1.0)
    look(scene, direction)
    save(scene, path)


def paint(report: dict[str, Any], stl: Path, out: Path) -> list[str]:
    """All pictures into the folder `out`; returns what their labels miss, by picture."""
    for name, row in report["parts"].items():
        part_picture(name, row, stl, out / f"{name}.png")
    every = things(report, stl)
    missed = exploded(every, out / "exploded.png")
    car(every, out / "car.png", (1.25, 1.0, 0.62))
    car(every, out / "car_rear.png", (-1.2, 1.0, 0.7))
    car(every, out / "car_side.png", (0.0, 1.0, 0.06))
    for step in steps.STEPS:
        missed += steps.step_picture(every, step, out / f"step_{step.name}.png")
    for insert in INSERTS:
        missed += steps.insert_picture(every, report, insert, file(insert, out))
    return missed
