"""What `make hardware` calls a difference: found for each kind, and none in the committed files."""

from __future__ import annotations

import copy
import importlib
import json
import shutil
import sys

import ezdxf
import pytest
import trimesh
from PIL import Image, ImageDraw

from tests.common import HARDWARE

sys.path.append(str(HARDWARE / "cad"))
comparison = importlib.import_module("compare")
BUILT = json.loads((HARDWARE / "cad" / "built.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_committed_files_do_not_differ_from_themselves():
    assert comparison.differences(BUILT, copy.deepcopy(BUILT)) == []
    assert comparison.stl_differences(HARDWARE / "stl", HARDWARE / "stl") == []
    assert comparison.dxf_differences(HARDWARE / "dxf", HARDWARE / "dxf") == []


@pytest.mark.slow
def test_another_picture_is_detected(tmp_path):
    """A badge more is a difference, a little noise of another renderer is none."""
    old = tmp_path / "old"
    new = tmp_path / "new"
    for folder in (old, new):
        folder.mkdir()
    image = Image.open(HARDWARE / "pictures" / "step_S08.png").convert("RGB")
    image.save(old / "a.png")
    noisy = image.point(lambda v: min(255, v + 2))
    noisy.save(new / "a.png")
    assert comparison.picture_differences(old, new) == []
    box = ImageDraw.Draw(noisy)
    box.ellipse((300, 300, 380, 380), fill="#b3261e")
    noisy.save(new / "a.png")
    (new / "b.png").write_bytes((new / "a.png").read_bytes())
    rows = comparison.picture_differences(old, new)
    assert [r[:2] for r in rows] == [("a.png", "grey tone"), ("b.png", "file")]


def move_hole(report):
    report["parts"]["base_plate"]["holes"][0]["at"][0] += 0.2


def heavier(report):
    report["parts"]["lidar_mount"]["volume_mm3"] *= 1.002


def longer(report):
    report["parts"]["sensor_gate"]["box_mm"][1][0] += 0.05


def remove_part(report):
    del report["parts"]["shock_ring"]


def turn_part(report):
    report["placements"][0]["matrix"][0][3] = 1.0


def blind(report):
    report["lidar"]["free_left_deg"] = 20


def thicker(report):
    next(i for i in report["items"] if i["name"] == "lidar")["shapes"][0]["z"][1] += 0.5


@pytest.mark.parametrize(("change", "name", "what"), [
    (thicker, "lidar", "item"),
    (move_hole, "base_plate", "hole 0"), (heavier, "lidar_mount", "volume mm3"),
    (longer, "sensor_gate", "bounding box mm"), (remove_part, "shock_ring", "part"),
    (turn_part, "base_plate", "placement"), (blind, "assembly", "lidar")])
@pytest.mark.slow_except("turn_part*", "thicker*", "heavier*", "blind*", "move_hole*", "longer*")
def test_changes_of_the_table_are_named(change, name, what):
    new = copy.deepcopy(BUILT)
    change(new)
    rows = comparison.differences(BUILT, new)
    assert [row[:2] for row in rows] == [(name, what)]
    assert rows[0][2] != rows[0][3]


def test_less_than_a_thousandth_is_no_difference():
    new = copy.deepcopy(BUILT)
    new["parts"]["lidar_mount"]["volume_mm3"] *= 1.0005
    assert comparison.differences(BUILT, new) == []


@pytest.mark.slow
def test_changed_meshes_and_drawings_are_named(tmp_path):
    for folder in ("stl", "dxf"):
        shutil.copytree(HARDWARE / folder, tmp_path / folder)
    body = trimesh.load_mesh(tmp_path / "stl" / "shock_ring.stl")
    body.apply_scale([1, 1, 1.01])
    body.export(tmp_path / "stl" / "shock_ring.stl")
    (tmp_path / "stl" / "magnet_ring.stl").unlink()
    document = ezdxf.readfile(tmp_path / "dxf" / "base_plate.dxf")
    next(iter(document.modelspace().query("CIRCLE"))).dxf.radius += 0.05
    document.saveas(tmp_path / "dxf" / "base_plate.dxf")
    stl = comparison.stl_differences(HARDWARE / "stl", tmp_path / "stl")
    assert [row[:2] for row in stl] == [("magnet_ring.stl", "file"),
                                        ("shock_ring.stl", "volume mm3"),
                                        ("shock_ring.stl", "bounding box mm")]
    dxf = comparison.dxf_differences(HARDWARE / "dxf", tmp_path / "dxf")
    assert dxf
    assert {row[0] for row in dxf} == {"base_plate.dxf"}
