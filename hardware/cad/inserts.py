"""Exploded view of the screws of a step: parts apart, each screw pulled out of its hole.

The words come from the rows of screws.csv, so the legend needs no renderer.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import fasteners  # first: puts the folder of screws.py on the path
import screws
from legends import Legend

HEADS = {"cap": "socket head", "button": "button head", "pan": "pan head", "": "nuts"}
COUNT = {1: "one", 2: "two", 4: "four"}


@dataclass(frozen=True)
class Insert:
    """One picture: bodies and how far each is pulled apart, mm; `view` as in `steps`."""

    name: str
    step: str
    bodies: dict[str, tuple[float, float, float]]
    view: tuple[float, float, float]


INSERTS = (
    Insert("S08_screws", "S08", {
        "base_plate": (0, 0, 0), "standoffs_lower": (0, 0, 34), "nano_imu_mount": (0, 0, 26),
        "imu": (0, 0, 48), "lidar_adapter": (0, 0, 40), "board_holder_": (0, 0, 26),
        "board_posts": (0, 0, -40)}, (1.0, 1.1, 0.75)),
    Insert("S11_screws", "S11", {"base_plate": (0, 0, 0), "lidar_mount": (0, 0, 24),
                                 "lidar": (0, 0, 48)}, (1.2, 0.9, 0.55)),
    Insert("S12_screws", "S12", {
        "upper_plate": (0, 0, 0), "camera_bracket": (34, 0, 0), "camera": (70, 0, 0),
        "small_board_holder_": (0, 0, -26), "back_plate": (-46, 0, 0),
        "standoffs_upper": (0, 0, -26)}, (1.0, 1.15, 0.55)),
    Insert("W09_screws", "W09", {"upper_plate": (0, 0, 0), "cutoff_holder": (0, 0, 24),
                                 "cutoff_board": (0, 0, 40)}, (0.8, -1.1, 0.8)),
)
PULL = 1.15
"""A screw comes out by this share of its length, or 14 mm."""


def rows_of(insert: Insert) -> list[tuple[int, screws.Screw]]:
    """Number in screws.csv and row of every screw of the step."""
    return [(n, row) for n, row in enumerate(screws.load()) if row.step == insert.step]


def words(row: screws.Screw) -> str:
    """What the legend says about a row."""
    if not row.length:
        return f"{COUNT.get(row.pieces, row.pieces)} nuts {row.size} on the studs"
    nut = " and nut" if row.end == "nut" else ""
    made = f" of {row.material}" if row.material != "steel" else ""
    return (f"{COUNT.get(row.pieces, row.pieces)} {row.name}{made}, {HEADS[row.head]} "
            f"{screws.SIDES[row.drive]}{nut}")


def legend(insert: Insert) -> Legend:
    """The words at the foremost screw of each row."""
    return tuple((words(row), f"first {n} {'head' if row.length else 'nut'}")
                 for n, row in rows_of(insert))


def foremost(insert: Insert, some: list[fasteners.Fastener]) -> int:
    """The fastener nearest to the camera: what stands before a row does not hide it."""
    return max(range(len(some)), key=lambda n: sum(
        a * b for a, b in zip(some[n].seat, insert.view, strict=True)))


def moved(insert: Insert, f: fasteners.Fastener, kind: str) -> tuple[float, float, float]:
    """Where a piece goes: with the part below the head, then out; the nut the other way."""
    part = next((shift for name, shift in insert.bodies.items()
                 if any(name.startswith(q) or q.startswith(name) for q, _ in f.row.holes[:1])),
                (0.0, 0.0, 0.0))
    last = next((shift for name, shift in insert.bodies.items()
                 if name.startswith(f.row.through or f.row.holes[-1][0])), part)
    if kind == "nut" and f.row.length:
        out, base = 12.0 + 0.5 * f.row.length, last
    else:
        out, base = -max(14.0, PULL * f.row.length), part
        if not f.row.length:
            out = -14.0 if kind == "nut" else 0.0
    x, y, z = (b + out * w for b, w in zip(base, f.way, strict=True))
    return float(x), float(y), float(z)


def file(insert: Insert, folder: Path) -> Path:
    return folder / f"step_{insert.name}.png"
