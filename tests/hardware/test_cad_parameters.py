"""Impossible dimensions are refused by name, and nothing is written."""

from __future__ import annotations

import copy
import importlib
import math
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

CAD = Path(__file__).parents[2] / "hardware" / "cad"


def module(name: str) -> ModuleType:
    """A module of hardware/cad; its folder goes last on the path."""
    if str(CAD) not in sys.path:
        sys.path.append(str(CAD))
    return importlib.import_module(name)


parameters = module("parameters")
checks = module("checks")
RAW = parameters.read().raw


def problems(group: str, key: str, value: object) -> list[str]:
    """The message for the committed file with one value changed."""
    raw = copy.deepcopy(RAW)
    raw[group][key]["value"] = value
    try:
        p = parameters.parse(raw)
    except parameters.ParameterError as error:
        return error.problems
    return checks.relations(p)


def test_the_committed_file_can_be_built():
    assert checks.relations(checks.load()) == []


def test_every_value_has_unit_bounds_source_and_comment():
    for group, entries in RAW.items():
        for key, entry in entries.items():
            assert set(entry) == set(parameters.KEYS), f"{group}.{key}"
            assert entry["comment"], f"{group}.{key}"
    assert {e["source"] for g in RAW.values() for e in g.values()} <= set(parameters.SOURCES)


@pytest.mark.slow_except("rings-*", "stack-*")
@pytest.mark.parametrize(("group", "key", "value", "words"), [
    ("base_holes", "bracket_half", 72.0, ("base_holes.bracket_half", "72", "40 to 66")),
    ("base_holes", "cable_x", [50.0, 4.0], ("base_holes.cable_x", "4", "10 to 160")),
    ("jetson", "y", [63.0, -42.7], ("jetson.y", "63", "bounds -65 to 65", "outside the plate")),
    ("base_holes", "antenna_y", [36.15, -4.0], ("antenna_y", "web between two cuts")),
    ("gate", "wall", 0.6, ("gate.wall", "0.6", "bounds 0.4 to 3", "at least 0.80")),
    ("imu_nano", "wall", 1.19, ("imu_nano.wall", "outside", "1.2 to 3")),
    ("rings", "tip", 14.0, ("rings.tip", "14.0", "bounds 8 to 15", "recess", "at most 13.00")),
    ("gear", "hub", 11.0, ("gear.hub", "11.0", "bounds 4 to 15", "bore")),
    ("rings", "magnet_radius", 11.2, ("rings.magnet_radius", "11.2", "wall outside the magnets")),
    ("hall", "boss", 16.0, ("hall.boss", "16.0", "bounds 6 to 25", "wall between boss")),
    ("gate", "slit_x", 4.1, ("gate.slit_x", "4.1")),
    ("holders", "oblong", 2.8, ("holders.small_size", "oblong", "leg beyond its hole")),
    ("rings", "teeth", 9.5, ("rings.teeth", "9.5", "whole number")),
    ("rings", "teeth", 12, ("rings.teeth", "12 1, bounds 1 to 32", "slit", "at least 2.60")),
    ("jetson", "x", [35.0], ("jetson.x = [35.0]", "a list of 2 numbers")),
    ("gear", "hub", [8.4, 8.4], ("gear.hub", "one number")),
    ("upper", "outline_left", [0.0, 70.0, 30.0], ("upper.outline_left", "three points")),
    ("stack", "gap", 57.0, ("stack.gap", "57.0", "gap that the brackets close")),
    ("camera", "width", 34.3, ("camera.width", "34.3", "notch")),
    ("lidar", "top_z", 56.0, ("lidar.top_z", "56.0", "below the camera bracket")),
    ("hall", "air_gap", math.nan, ("hall.air_gap", "nan", "0.5 to 1.9")),
    ("sheet", "thickness", "3 mm", ("sheet.thickness", "3 mm", "expected a number")),
    ("sheet", "thickness", True, ("sheet.thickness", "expected a number")),
])
def test_impossible_values_are_named_with_their_bounds(group, key, value, words):
    text = "\n".join(problems(group, key, value))
    assert text, "accepted"
    for word in words:
        assert word in text


def test_entries_that_are_not_entries_are_named():
    raw = copy.deepcopy(RAW)
    raw["sheet"]["thickness"] = 3.0
    del raw["gear"]["hub"]["unit"]
    raw["shock"]["bore"]["source"] = "guessed"
    with pytest.raises(parameters.ParameterError) as error:
        parameters.parse(raw)
    text = str(error.value)
    for word in ("sheet.thickness = 3.0", "gear.hub: missing ['unit']", "shock.bore: source"):
        assert word in text


@pytest.mark.parametrize(("group", "key", "message"), [
    ("jetson", "x", "jetson.x: missing"), ("rings", "tip", "rings.tip: missing"),
    ("shock", None, "[shock]: missing")])
def test_what_is_missing_is_named(group, key, message):
    raw = copy.deepcopy(RAW)
    if key:
        del raw[group][key]
    else:
        del raw[group]
    with pytest.raises(parameters.ParameterError) as error:
        checks.relations(parameters.parse(raw))
    assert message in str(error.value)


@pytest.mark.slow
def test_a_measured_value_within_reason_passes():
    """The control: not every change is refused."""
    assert problems("gear", "hub", 8.3) == []
    assert problems("camera", "lens_above", 9.0) == []
    assert problems("sheet", "thickness", 2.75) == []
    assert problems("sheet", "thickness", 3.3) == []


@pytest.mark.parametrize("text", ["[rings]\ntip = { value = 1", ""])
def test_the_build_refuses_and_writes_nothing(tmp_path, text):
    """Exit code 2 before any CAD library is needed; the committed table keeps its time."""
    bad = tmp_path / "bad.toml"
    source = (CAD / "parameters.toml").read_text(encoding="utf-8")
    bad.write_text(text or source.replace("tip = { value = 12.1", "tip = { value = 14.4"),
                   encoding="utf-8")
    before = {f: f.stat().st_mtime_ns for f in CAD.parent.rglob("*.[sdj][txs]*")}
    done = subprocess.run([sys.executable, CAD / "build.py", "--write", "--parameters", bad],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "nothing was written" in done.stderr
    assert text or "rings.tip (14.4 mm, bounds 8 to 15)" in done.stderr
    assert {f: f.stat().st_mtime_ns for f in CAD.parent.rglob("*.[sdj][txs]*")} == before
