"""One picture per step of the build guide: its parts in colour, what is there already in grey."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
import trimesh
from fasteners import of_row
from inserts import Insert, foremost, legend, moved, rows_of
from legends import LEGENDS
from pointing import Shown, astray
from scene import MARK, Thing, add, look, save, stage
from shapes import body, prism

GREY = "#d4d6d8"
SHRUNK = 0.99


@dataclass(frozen=True)
class Step:
    """What a step shows. Names match bodies by their beginning.

    `bounds` frames the picture (x0, x1, y0, y1, z0, z1 in mm of the deck frame); `moved` shifts
    bodies, mm; `ghost` bodies can be seen through.
    """

    name: str
    new: tuple[str, ...]
    old: tuple[str, ...]
    view: tuple[float, float, float]
    bounds: tuple[float, ...] | None = None
    ghost: tuple[str, ...] = ()
    moved: dict[str, tuple[float, float, float]] = field(default_factory=dict)


BELOW = ("chassis", "shocks", "rear_gearbox", "bumper", "servo", "linkage", "front_wheel")
BOARD = ("expansion_board", "cells", "board_posts")
DECK = ("base_plate", "standoffs_lower", "nano_imu_mount", "imu", "lidar_adapter", "board_holder")
ENCODER = ("gear", "striped_ring", "ir_module", "sensor_gate")
TOP = (*BELOW, *BOARD, *DECK, "antennas", "jetson", "cable_6pin", "lidar")

STEPS = (
    Step("S01", (*BELOW, "expansion_board", "board_posts"), (), (1.25, 1.0, 0.75)),
    Step("S02", ("gear", "rear_gearbox"), ("chassis", "shocks", "front_wheel"), (-1.0, 0.75, 1.1)),
    Step("S03", ("striped_ring", "gear"), (), (1.0, 1.3, 0.5), moved={"striped_ring": (16, 0, 0)}),
    Step("S03_rear", ("magnet", "gear"), (), (-1.0, 1.3, 0.5),
         moved={"magnet_ring": (-14, 0, 0), "magnets": (-24, 0, 0)}),
    Step("S04", ("sensor_gate", "ir_module", "ir_ties", "striped_ring"), ("gear",),
         (0.75, 1.1, 1.1), ghost=("gear", "sensor_gate")),
    Step("S05", ("hall_holder", "hall_sensor", "magnet"), ("gear", "rear_gearbox"),
         (-0.8, 1.0, 0.6), (-4.0, 26.0, -22.0, 27.0, -56.0, -20.0), ghost=("rear_gearbox",)),
    Step("S06", ("shock_ring_front_left", "shocks"), ("chassis",), (1.0, 0.25, 0.3),
         (160.0, 186.0, 24.0, 62.0, -50.0, -4.0)),
    Step("S06_servo", ("servo", "linkage", *ENCODER),
         ("chassis", "shocks", "rear_gearbox", "front_wheel"), (0.4, -1.0, 0.9),
         (10.0, 165.0, -85.0, 5.0, -56.0, -20.0)),
    Step("S06_centre", ("servo", "linkage"), (), (0.25, -1.0, 0.35)),
    Step("S07", ("cells", "expansion_board"), ("board_posts",), (0.75, 0.9, -1.3),
         moved={"cells": (0, 0, -30)}),
    Step("S08", (*DECK, "screw 0 ", "screw 1 "), (*BELOW, *BOARD), (1.25, 1.0, 0.8)),
    Step("S09", ("antennas", "base_plate", "cable_6pin"), (*BELOW, *BOARD, *DECK),
         (-0.9, -0.5, 1.6)),
    Step("S10", ("jetson", "cable_6pin"), (*BELOW, *BOARD, *DECK, "antennas"), (-1.2, 0.75, 0.35)),
    Step("S11", ("lidar", "lidar_mount", "lidar_lead", "screw 6 "),
         (*BELOW, *BOARD, *DECK, "antennas", "jetson", "cable_6pin"), (1.25, 1.0, 0.75)),
    Step("S12_camera", ("camera", "camera_bracket", "screw 7 ", "screw 8 "), ("jetson",),
         (0.75, -1.0, 1.0)),
    Step("S12", ("upper_plate", "back_plate", "small_board_holder", "standoffs_upper", "camera"),
         TOP, (-1.1, 1.0, 0.7)),
    Step("S13", ("nano", "nano_tie", "imu"),
         ("base_plate", "standoffs_lower", "nano_imu_mount", "screw 3 ", "screw 4 "),
         (1.0, -1.0, 1.4), (10.0, 82.0, -75.0, 20.0, 0.0, 12.0)),
    Step("S14", ("lipo", "battery_bar", "battery_leads", "fuse"),
         ("chassis", "front_wheel", "shocks"), (0.35, 1.2, 0.8)),
    Step("W06", ("usb_", "cable_6pin", "jumpers", "lead_", "battery_leads", "fuse"),
         ("base_plate", "nano", "jetson", "lidar", "imu", "standoffs_lower", "expansion_board",
          "ir_module", "back_plate", "chassis", "front_wheel", "servo"), (-0.9, -1.15, 0.7),
         ghost=("jetson", "expansion_board")),
    Step("W06_front", ("jumpers", "lead_", "battery_leads", "fuse", "cable_6pin"),
         ("base_plate", "nano", "expansion_board", "ir_module", "chassis", "front_wheel", "jetson"),
         (1.2, 0.75, 0.75), ghost=("expansion_board", "base_plate", "jetson")),
)
FORWARD = [(215.0, -7.0), (240.0, -7.0), (240.0, 7.0), (215.0, 7.0)], [
    (240.0, -16.0), (262.0, 0.0), (240.0, 16.0)]
"""Red arrow on the floor before a car, mm: its shaft and its head."""


def is_of(name: str, wanted: str) -> bool:
    """A body by its name, or by a beginning that ends in "_"."""
    return name == wanted or (wanted.endswith("_") and name.startswith(wanted))


def insert_picture(every: list[Thing], report: dict[str, Any], insert: Insert,
                   path: Path) -> list[str]:
    """Parts of a step apart, each of its screws pulled out of its hole along a thin line; what its
    labels miss."""
    scene, drawn = stage((1700, 1300)), list[Shown]()
    for thing in every:
        shift = next((v for n, v in insert.bodies.items() if is_of(thing.name, n)), None)
        if shift is not None:
            mesh = thing.mesh.copy()
            mesh.apply_translation(shift)
            add(scene, mesh, thing.colour, 0.45 if thing.clear else 1.0)
            drawn.append(Shown(thing.name, mesh, thing.clear))
    for number, row in rows_of(insert):
        every_one = of_row(report, row)
        first = foremost(insert, every_one)
        for n, f in enumerate(every_one):
            ends = []
            for kind, shape in f.pieces.items():
                mesh = body(shape)
                mesh.apply_translation(moved(insert, f, kind))
                add(scene, mesh, MARK if kind == "head" or not row.length else shape["colour"])
                ends.append(mesh.bounds.mean(axis=0))
                drawn.append(Shown(f"{'first' if n == first else 'next'} {number} {kind}", mesh))
            low, high = ends[0], np.array(f.at(f.grip)) + (ends[-1] - np.array(f.at(f.grip)))
            scene.add_mesh(pv.Line(low, high), color=MARK, line_width=2)
    look(scene, insert.view)
    save(scene, path, legend(insert), drawn)
    return [f"{path.name}: {said}" for said in astray(legend(insert), drawn, insert.view)]


def names(thing: Thing, starts: tuple[str, ...]) -> bool:
    return any(thing.name.startswith(s) for s in starts)


def arrow(low: float) -> list[trimesh.Trimesh]:
    """The arrow on the floor at the height `low`."""
    return [body(prism(points, low, low + 1.0)) for points in FORWARD]


def step_picture(every: list[Thing], step: Step, path: Path) -> list[str]:
    """Paints one step; returns what its labels miss."""
    scene, drawn = stage((1700, 1300)), list[Shown]()
    for thing in every:
        new, old = names(thing, step.new), names(thing, step.old)
        if not new and not old:
            continue
        mesh = thing.mesh
        for start, shift in step.moved.items():
            if thing.name.startswith(start):
                mesh = mesh.copy()
                mesh.apply_translation(shift)
        if names(thing, step.ghost):  # faces that lie on those of others would flicker
            mesh = mesh.copy()
            mesh.apply_transform(trimesh.transformations.scale_matrix(SHRUNK, mesh.bounds.mean(0)))
        colour = thing.colour if new else GREY
        seen_through = thing.clear or names(thing, step.ghost)
        add(scene, mesh, colour, 0.4 if seen_through else 1.0, width=2.0 if new else 1.0)
        drawn.append(Shown(thing.name, mesh, seen_through))
    if step.bounds is None and any(s.name == "chassis" for s in drawn):
        for mesh in arrow(min(s.mesh.bounds[0][2] for s in drawn)):
            add(scene, mesh, MARK)
    look(scene, step.view, step.bounds)
    save(scene, path, LEGENDS[step.name], drawn)
    return [f"{path.name}: {said}" for said in astray(LEGENDS[step.name], drawn, step.view)]
