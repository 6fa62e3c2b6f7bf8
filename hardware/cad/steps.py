"""One picture per step of the build guide: its parts in colour, what is there already in grey."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import trimesh
from legends import LEGENDS
from scene import MARK, Thing, add, look, save, stage
from shapes import body, prism

GREY = "#d4d6d8"


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


BELOW = ("chassis", "shocks", "rear_gearbox", "bumper", "servo")
BOARD = ("expansion_board", "cells", "board_posts")
DECK = ("base_plate", "lidar", "standoffs_lower", "nano_imu_mount", "imu")
ENCODER = ("gear", "striped_ring", "ir_module", "sensor_gate")

STEPS = (
    Step("S01", (*BELOW, "expansion_board", "board_posts"), (), (1.25, 1.0, 0.75)),
    Step("S02", ("gear", "rear_gearbox"), ("chassis", "shocks"), (-1.0, 0.75, 1.1)),
    Step("S03", ("striped_ring", "magnet", "gear"), (), (1.0, 1.3, 0.5),
         moved={"striped_ring": (16, 0, 0), "magnet": (-16, 0, 0)}),
    Step("S04", ("sensor_gate", "ir_module", "striped_ring"), ("gear",), (-0.7, 1.25, 0.65),
         ghost=("gear",), moved={"striped_ring": (-12, 0, 0), "gear": (-12, 0, 0)}),
    Step("S05", ("hall_holder", "hall_sensor", "magnet"), ("gear", "rear_gearbox"),
         (-0.8, 1.0, 0.6), (-2.0, 26.0, -22.0, 26.0, -50.0, -16.0), ghost=("rear_gearbox",)),
    Step("S06", ("shock_ring_front_left", "shocks"), ("chassis",), (1.0, 0.35, 0.35),
         (160.0, 186.0, 24.0, 62.0, -44.0, -4.0)),
    Step("S06_servo", ("servo", *ENCODER), ("chassis", "shocks", "rear_gearbox"),
         (0.5, -0.9, 1.2)),
    Step("S07", ("cells", "expansion_board"), ("board_posts",), (1.0, 0.8, -1.2)),
    Step("S08", ("base_plate", "lidar_mount", "lidar", "standoffs_lower", "lidar_adapter",
                 "nano_imu_mount", "imu"),
         (*BELOW, *BOARD), (1.25, 1.0, 0.8)),
    Step("S09", ("antennas", "base_plate"), (*BELOW, *BOARD, *DECK), (-0.9, -0.5, 1.6),
         ghost=("lidar",)),
    Step("S10", ("jetson",), (*BELOW, *BOARD, *DECK, "antennas"),
         (-1.2, 0.75, 0.35)),
    Step("S11", ("camera", "camera_bracket"), ("upper_plate",), (1.2, 0.9, 0.7),
         (78.0, 150.0, -36.0, 36.0, 50.0, 90.0)),
    Step("S12", ("upper_plate", "back_plate", "board_holder", "small_board_holder",
                 "standoffs_upper"),
         (*BELOW, *BOARD, *DECK, "antennas", "jetson", "camera"),
         (-1.1, 1.0, 0.7)),
    Step("S13", ("nano", "imu"), ("base_plate", "standoffs_lower"),
         (1.0, -1.0, 1.4), (10.0, 82.0, -75.0, 20.0, 0.0, 12.0)),
    Step("S14", ("lipo",), ("",), (-1.0, 1.2, 0.7)),
)
FORWARD = [(215.0, -7.0), (240.0, -7.0), (240.0, 7.0), (215.0, 7.0)], [
    (240.0, -16.0), (262.0, 0.0), (240.0, 16.0)]
"""Red arrow on the floor before a car, mm: its shaft and its head."""


def names(thing: Thing, starts: tuple[str, ...]) -> bool:
    return any(thing.name.startswith(s) for s in starts)


def arrow(low: float) -> list[trimesh.Trimesh]:
    """The arrow on the floor at the height `low`."""
    return [body(prism(points, low, low + 1.0)) for points in FORWARD]


def step_picture(every: list[Thing], step: Step, path: Path) -> None:
    """Paints one step."""
    scene, drawn = stage((1700, 1300)), []
    for thing in every:
        new, old = names(thing, step.new), names(thing, step.old)
        if not new and not old:
            continue
        mesh = thing.mesh
        for start, shift in step.moved.items():
            if thing.name.startswith(start):
                mesh = mesh.copy()
                mesh.apply_translation(shift)
        colour = thing.colour if new else GREY
        seen_through = thing.clear or names(thing, step.ghost)
        add(scene, mesh, colour, 0.4 if seen_through else 1.0, width=2.0 if new else 1.0)
        drawn.append((thing.name, mesh))
    if step.bounds is None and any(name == "chassis" for name, _ in drawn):
        for mesh in arrow(min(m.bounds[0][2] for _, m in drawn)):
            add(scene, mesh, MARK)
    look(scene, step.view, step.bounds)
    save(scene, path, LEGENDS[step.name], drawn)
