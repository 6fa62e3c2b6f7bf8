"""The numbers of a picture point at what their lines name; each way to miss is named."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest
import trimesh

sys.path.append(str(Path(__file__).parents[2] / "hardware" / "cad"))
pointing = importlib.import_module("pointing")
Shown = pointing.Shown
VIEW = (1.0, 0.0, 0.0)


def cube(name: str, x: float, clear: bool = False, y: float = 0.0):
    mesh = trimesh.creation.box([10, 10, 10])
    mesh.apply_translation([x, y, 0])
    return Shown(name, mesh, clear)


BEHIND = cube("imu", 0.0)


@pytest.mark.parametrize(("target", "others", "message"), [
    ((3.0, 0.0, 0.0), (), []),
    ("imu", (), []),
    ((3.0, 0.0, 0.0), (cube("plate", 30.0, clear=True),), []),
    ((3.0, 0.0, 0.0), (cube("standoff", 30.0),), ["points at standoff, imu is meant"]),
    ("imu", (cube("standoff", 30.0),), ["points at standoff, imu is meant"]),
    ("imu", (cube("imu", 0.0, y=40.0), cube("standoff", 30.0)), ["points past imu"]),
    ((3.0, 0.0, 0.0), (cube("standoff", -30.0), cube("standoff", 30.0, y=12.0)), []),
])
def test_what_hides_a_part_is_named_and_what_is_clear_is_passed(target, others, message):
    found = list(pointing.astray((("IMU", target),), [BEHIND, *others], VIEW))
    assert found == [f"number 1 (IMU) {text}" for text in message]


def test_a_name_that_is_not_in_the_picture_lists_those_that_are():
    with pytest.raises(ValueError, match=r"nothing in the picture is named 'servo'.*'imu'"):
        list(pointing.astray((("servo", "servo"),), [BEHIND], VIEW))
