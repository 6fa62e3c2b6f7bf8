"""One picture per step of the build guide: its parts in colour, what is there already in grey."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from pictures import Thing, add, look, save, stage

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

STEPS = (
    Step("S01", (*BELOW, *BOARD), (), (1.25, 1.0, 0.75)),
    Step("S03", ("striped_ring", "magnet", "gear"), (), (1.0, 1.3, 0.5),
         moved={"striped_ring": (16, 0, 0), "magnet": (-16, 0, 0)}),
    Step("S04", ("sensor_gate", "ir_module", "striped_ring"), ("gear",), (-0.7, 1.25, 0.65),
         ghost=("gear",), moved={"striped_ring": (-12, 0, 0), "gear": (-12, 0, 0)}),
    Step("S05", ("hall_holder", "hall_sensor", "magnet"), ("gear", "rear_gearbox"),
         (-0.8, 1.0, 0.6), (-2.0, 26.0, -22.0, 26.0, -50.0, -16.0), ghost=("rear_gearbox",)),
    Step("S06", ("shock_ring_front_left", "shocks"), ("chassis",), (1.0, 0.35, 0.35),
         (160.0, 186.0, 24.0, 62.0, -44.0, -4.0)),
    Step("S08", ("base_plate", "lidar_mount", "lidar", "standoffs_lower", "lidar_adapter",
                 "nano_imu_mount", "imu"),
         (*BELOW, *BOARD), (1.25, 1.0, 0.8)),
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


def names(thing: Thing, starts: tuple[str, ...]) -> bool:
    return any(thing.name.startswith(s) for s in starts)


def step_picture(every: list[Thing], step: Step, path: Path) -> None:
    """Paints one step."""
    scene = stage((1700, 1300))
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
    look(scene, step.view, step.bounds)
    save(scene, path)
