"""Committed meshes: closed, one body, printable, with the holes that the table promises."""

from __future__ import annotations

import csv
import importlib
import json
import math
import sys
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.common import HARDWARE

sys.path.append(str(HARDWARE / "cad"))
parameters, probe, layout = (importlib.import_module(n)
                             for n in ("parameters", "probe", "layout"))
P = parameters.read()
BUILT = json.loads((HARDWARE / "cad" / "built.json").read_text(encoding="utf-8"))
PARTS: dict[str, dict[str, Any]] = BUILT["parts"]
PRINTED = sorted(n for n, row in PARTS.items() if row["process"] == "printed")


def mesh(name: str) -> trimesh.Trimesh:
    return trimesh.load_mesh(HARDWARE / "stl" / f"{name}.stl")


def faults(body: trimesh.Trimesh, row: dict[str, Any]) -> list[str]:
    """Everything by which a mesh is not the part of the table."""
    found = []
    if not (body.is_watertight and body.is_winding_consistent):
        found.append("not closed")
    if body.body_count != 1:
        found.append(f"{body.body_count} bodies")
    if abs(body.volume - row["volume_mm3"]) > 1e-3 * row["volume_mm3"]:
        found.append(f"volume {body.volume:.1f}")
    if np.abs(body.bounds - row["box_mm"]).max() > 0.02:
        found.append(f"box {body.bounds.tolist()}")
    if abs(body.bounds[0][2]) > 1e-6:
        found.append("not on the bed")
    found += [f"hole at {hole['at']}" for hole in row["holes"]
              if probe.hole_error(body, hole) > 0.05]
    return found


@pytest.mark.parametrize("name", sorted(PARTS))
def test_the_mesh_is_the_part(name):
    assert faults(mesh(name), PARTS[name]) == []


def test_there_is_one_mesh_per_part():
    assert {f.stem for f in (HARDWARE / "stl").glob("*.stl")} == set(PARTS)
    assert {f.stem for f in (HARDWARE / "dxf").glob("*.dxf")} == set(PARTS) - set(PRINTED)
    assert set(PARTS) <= {f.stem for f in (HARDWARE / "pictures").glob("*.png")}


def test_broken_meshes_are_found():
    """Controls: a hole moved by 0.2, a triangle gone, a second body, a part off the bed."""
    row = PARTS["board_holder"]
    good = mesh("board_holder")
    moved = {**row, "holes": [{**row["holes"][0], "at": [10.2, 0.0, 1.2]}]}
    assert faults(good, moved) == ["hole at [10.2, 0.0, 1.2]"]
    wider = {**row, "holes": [{**row["holes"][0], "diameter": 3.5}]}
    assert "hole at [10.0, 0.0, 1.2]" in faults(good, wider)
    none = {**row, "holes": [{**row["holes"][0], "at": [4.0, 4.0, 1.2]}]}
    assert faults(good, none) == ["hole at [4.0, 4.0, 1.2]"]
    torn = good.copy()
    torn.update_faces(np.arange(len(torn.faces)) > 0)
    assert "not closed" in faults(torn, row)
    double = good + trimesh.creation.box(bounds=[[12, -3, 12], [14, 3, 14]])
    assert "2 bodies" in faults(double, row)
    lifted = good.copy()
    lifted.apply_translation([0, 0, 0.5])
    assert "not on the bed" in faults(lifted, row)


@pytest.mark.parametrize("name", sorted(PARTS))
@pytest.mark.slow_except("board_holder", "back_plate", "hall_holder", "*ring", "sensor_gate")
def test_walls_are_thick_enough(name):
    """Least wall that the part declares, and that never below what its process can make."""
    row = PARTS[name]
    process = P.printer.wall_min_gate if row["process"] == "printed" else P.sheet.ring_thickness
    assert row["wall_min"] >= process
    least = min(row["wall_min"], P.sheet.ring_thickness if row["process"] == "cut" else math.inf)
    assert probe.walls(mesh(name)).min() >= least - 0.02


def test_a_thin_wall_is_found():
    body = mesh("sensor_gate")
    thin = trimesh.creation.box([20, 20, 2]) + trimesh.creation.box(
        bounds=[[-10, -10, 1], [-9.4, 10, 8]])
    assert probe.walls(thin).min() == pytest.approx(0.6, abs=0.01)
    body.apply_scale([0.6, 1.0, 1.0])
    assert probe.walls(body).min() < P.printer.wall_min_gate


@pytest.mark.parametrize("name", sorted(PARTS))
def test_parts_fit_the_bed(name):
    size = mesh(name).extents
    assert max(size[:2]) <= P.printer.bed


@pytest.mark.parametrize("name", PRINTED)
def test_parts_print_without_support(name):
    """As they lie in the file: steep enough, or bridges that are held at both ends."""
    ceilings = probe.spans(mesh(name), P.printer.overhang_max)
    assert [s for s, area in ceilings if s > P.printer.bridge_max and area > 0.5] == []


def test_overhangs_are_found():
    """Controls: a bracket on its head, a table, a bridge of 20 mm."""
    def worst(body: trimesh.Trimesh) -> float:
        return max((s for s, _ in probe.spans(body, 50.0)), default=0.0)

    holder = mesh("camera_bracket")
    holder.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, [1, 0, 0]))
    holder.apply_translation([0, 0, -holder.bounds[0][2]])
    assert worst(holder) > P.printer.bridge_max
    table = trimesh.boolean.union([trimesh.creation.box(bounds=[[-2, -2, 0], [2, 2, 10]]),
                                   trimesh.creation.box(bounds=[[-2, -2, 9], [20, 2, 10]])])
    assert worst(table) == math.inf
    bridge = trimesh.boolean.difference([trimesh.creation.box(bounds=[[0, 0, 0], [26, 30, 9]]),
                                         trimesh.creation.box(bounds=[[3, -1, -1], [23, 31, 6]])])
    assert worst(bridge) == pytest.approx(20.0, abs=0.1)


def screw_faults(parts: dict[str, dict[str, Any]]) -> list[str]:
    """Screw holes that are not ISO 273 fine (printed ones: plus what the printer takes)."""
    found = []
    for name, row in parts.items():
        extra = P.printer.hole_extra if row["process"] == "printed" else 0.0
        for hole in row["holes"]:
            if hole["screw"] and abs(hole["diameter"] - layout.ISO_273_FINE[hole["screw"]]
                                     - extra) > 1e-6:
                found.append(f"{name}: {hole['screw']} in {hole['diameter']}")
    return found


def test_screw_holes_follow_iso_273_fine():
    assert layout.ISO_273_FINE == {"M1.6": 1.7, "M2": 2.2, "M2.5": 2.7, "M3": 3.2}
    assert screw_faults(PARTS) == []
    tight = json.loads(json.dumps(PARTS))
    tight["base_plate"]["holes"][0]["diameter"] = 2.5
    assert screw_faults(tight) == ["base_plate: M2.5 in 2.5"]


def test_screws_and_parts_are_in_the_bill_of_materials():
    with (HARDWARE / "bom.csv").open(encoding="utf-8", newline="") as file:
        rows = {r["id"]: r for r in csv.DictReader(file)}
    words = rows["screws"]["part"]
    used = {h["screw"] for row in PARTS.values() for h in row["holes"]} - {""}
    assert used
    assert all(f"{screw} x" in words for screw in used)
    custom = {i: r["custom"] for i, r in rows.items() if r["custom"] in ("printed", "cut")
              and i != "plates"}
    assert custom == {n: row["process"] for n, row in PARTS.items()}
    unknown = {i["bom"] for i in BUILT["items"]} - set(rows)
    assert not unknown
