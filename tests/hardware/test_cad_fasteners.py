"""The car can be screwed together: every rule on the committed car, every rule broken once."""

from __future__ import annotations

import copy
import importlib
import json
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.common import HARDWARE, ROOT

sys.path[:0] = [str(HARDWARE)]
sys.path.append(str(HARDWARE / "cad"))
battery, collisions, fasteners, fit, parameters, shapes, steering = (
    importlib.import_module(n) for n in ("battery", "collisions", "fasteners", "fit", "parameters",
                                         "shapes", "steering"))
screws = importlib.import_module("screws")
P = parameters.read()
BUILT: dict[str, Any] = json.loads((HARDWARE / "cad" / "built.json").read_text(encoding="utf-8"))
SCREW_ROWS = screws.load()
CAD = ROOT / ".venv-hardware" / "bin" / "python"


@pytest.fixture(scope="module")
def car() -> dict[str, list[trimesh.Trimesh]]:
    return fit.car(BUILT, HARDWARE / "stl")


def row(use: str, part: str = "") -> Any:
    """The row of screws.csv with a hole for this use."""
    return next(r for r in SCREW_ROWS if any(use == u and part in ("", q) for q, u in r.holes))


def check_rows(car: dict[str, list[trimesh.Trimesh]], *rows: Any, removed: str = "") -> str:
    """Findings of the rules for some rows alone."""
    bodies = {n: b for n, b in car.items() if not removed or not n.startswith(removed)}
    return "\n".join(fit.problems(BUILT, list(rows), bodies))


@pytest.mark.slow
def test_every_screw_of_the_car_goes_in(car):
    assert fit.problems(BUILT, SCREW_ROWS, car) == []
    assert len(fasteners.fasteners(BUILT, SCREW_ROWS)) == sum(r.pieces for r in SCREW_ROWS)


@pytest.mark.slow
def test_the_screws_of_the_lidar_go_in_from_above(car):
    lidar = row("lidar", "lidar_mount")
    assert (lidar.name, lidar.drive, lidar.material) == ("M3 x 25", "down", "steel")
    assert check_rows(car, lidar) == ""
    seats = [f.seat for f in fasteners.of_row(BUILT, lidar)]
    assert sorted(s[:2] for s in seats) == [(111.6, -31.0), (111.6, 31.0), (168.6, -25.0),
                                            (168.6, 25.0)]
    assert {s[2] for s in seats} == {P.sheet.thickness + P.lidar.pillar + P.lidar.ear}


@pytest.mark.slow
def test_a_screw_from_below_finds_no_thread_in_the_lidar(car):
    old = replace(row("lidar", "lidar_mount"), length=20.0, drive="up", other=0.0, other_at="",
                  end="thread")
    assert check_rows(car, old).count("0.0 mm of thread in lidar") == 4


@pytest.mark.slow
def test_a_lidar_below_the_upper_plate_is_out_of_reach(car):
    late = replace(row("lidar", "lidar_mount"), step="S13")
    assert "upper_plate is in the way of the driver" in check_rows(car, late)


@pytest.mark.slow
def test_long_screws_of_the_small_holders_meet(car):
    small = [r for r in SCREW_ROWS if any(q == "small_board_holder" for q, _ in r.holes)]
    assert [r.name for r in small] == ["M3 x 8", "M3 x 8"]
    assert check_rows(car, *small) == ""
    meet = check_rows(car, *(replace(r, length=10.0) for r in small))
    assert "its shank is in the shank of S12 M3 x 10" in meet


@pytest.mark.slow
def test_no_metal_is_over_the_live_jetson(car):
    cutoff = row("upper_plate", "cutoff_holder")
    assert cutoff.material == "nylon"
    assert check_rows(car, cutoff) == ""
    steel = check_rows(car, replace(cutoff, material="steel", drive="down", head="cap"))
    assert "mm above the live jetson, 8 mm or no metal" in steel
    assert "at (44.4, -27.0, " in steel


@pytest.mark.slow
def test_nuts_of_the_imu_do_not_hang_over_the_expansion_board(car):
    imu = row("imu", "nano_imu_mount")
    assert check_rows(car, imu) == ""
    over = check_rows(car, replace(imu, drive="down", other_at="head"))
    assert over.count("above the live expansion_board") >= 4


@pytest.mark.slow
def test_a_head_in_a_part_is_named(car):
    thick = replace(row("camera_bracket"), head="cap")
    assert "its head is in camera" in check_rows(car, thick)


@pytest.mark.slow
def test_a_nut_that_no_spanner_reaches_is_named(car):
    lidar = row("lidar", "lidar_mount")
    wall = {f"wall_{n}": [shapes.body(shapes.cylinder((*f.seat[:2], -8), (*f.seat[:2], 0), 9, "",
                                                      5))]
            for n, f in enumerate(fasteners.of_row(BUILT, lidar))}
    report = {**BUILT, "items": [*BUILT["items"], *({"name": n, "step": "S01", "shapes": []}
                                                    for n in wall)]}
    found = "\n".join(fit.problems(report, [lidar], {**car, **wall}))
    assert found.count("no side for a spanner at its nut") == 4
    assert "wall_0" in found


@pytest.mark.slow
def test_a_screw_too_many_is_counted(car):
    assert "4 in the car, 3 in screws.csv" in check_rows(car, replace(row("lidar", "lidar_mount"),
                                                                      pieces=3))


def test_parts_that_do_not_lie_on_each_other_are_detected():
    report = copy.deepcopy(BUILT)
    place = next(q for q in report["placements"] if q["name"] == "board_holder_left")
    place["matrix"][2][3] += 1.0
    low = replace(row("plate", "board_holder"))
    assert "parts do not lie on each other, 6.40 mm for 5.40" in "\n".join(
        fit.problems(report, [low], {}))


@pytest.mark.slow
def test_cables_keep_clear_of_the_turning_lidar(car):
    assert list(fit.near_rotor(P, car)) == []
    near = [m.copy().apply_translation([0, 0, -2.0]) for m in car["camera"]]
    assert list(fit.near_rotor(P, {**car, "camera": near})) == [
        "camera: less than 3 mm beside the turning lidar"]


def lies(shape: dict[str, Any], hub: tuple[float, float, float]) -> list[str]:
    """By what the body of the servo is not the one of the photographs."""
    low = np.array(shape["low"])
    high = np.array(shape["high"])
    found = []
    if high[2] - low[2] > high[1] - low[1]:
        found.append("stands upright")
    if abs(high[1]) > 15:
        found.append("bottom far from the middle line")
    if not low[0] + 5 < hub[0] < low[0] + 15:
        found.append("shaft not at the rear end")
    if hub[1] > low[1]:
        found.append("shaft not to the right")
    return found


def test_the_servo_lies_on_its_side_with_the_horn_to_the_right():
    body = next(i for i in BUILT["items"] if i["name"] == "servo")["shapes"][0]
    assert lies(body, steering.hub(P)) == []
    assert steering.link_end(P, 0.0)[2] > steering.hub(P)[2], "horn up"
    forward = steering.crank_point(P, -1, steering.CRANK, -np.pi / 2, 0.0)[0]
    assert forward > steering.link_end(P, 0.0)[0] + 40, "turnbuckle runs forward"
    upright = {"low": [75, -63.5, -53.6], "high": [115, -43.5, -17.6]}
    assert lies(upright, (85, -53.5, -13.1)) == [
        "stands upright", "bottom far from the middle line", "shaft not to the right"]


@pytest.mark.slow
def test_the_steering_moves_freely_from_stop_to_stop(car):
    below = {n: b for n, b in car.items() if lowest(b) < 0}
    stops = -1.0, 1.0  # the build tries five angles
    assert list(steering.sweep(P, below, stops)) == []
    wide = copy.deepcopy(P)
    wide.steering.throw = 45.0
    assert any("front_wheel" in text or "linkage meets" in text
               for text in steering.sweep(wide, below, stops)), "the control"


def lowest(meshes: list[trimesh.Trimesh]) -> float:
    return min(float(m.bounds[0][2]) for m in meshes)


@pytest.mark.slow
def test_the_battery_is_held(car):
    assert list(battery.loose(car)) == []
    free = {"lipo": car["lipo"]}
    assert len(list(battery.loose(free))) == 5, "the control"


@pytest.mark.slow
@pytest.mark.skipif(not CAD.exists(), reason="needs the CAD kernel of `make hardware`")
def test_a_file_that_makes_screws_collide_is_refused_and_nothing_is_written(tmp_path):
    text = (HARDWARE / "cad" / "parameters.toml").read_text(encoding="utf-8")
    for old, new in (("small_hole = { value = 8.0", "small_hole = { value = 6.4"),
                     ("bracket_x = { value = 8.0", "bracket_x = { value = 6.4"),
                     ("hole_v = { value = [13.0, 51.0]", "hole_v = { value = [13.0, 52.6]")):
        assert old in text
        text = text.replace(old, new)
    bad = tmp_path / "bad.toml"
    bad.write_text(text, encoding="utf-8")
    folders = [HARDWARE / f for f in ("stl", "step", "dxf", "drill", "pictures")]
    before = {f: f.stat().st_mtime_ns for d in folders for f in d.iterdir()}
    done = subprocess.run([CAD, HARDWARE / "cad" / "build.py", "--write", "--parameters", bad],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "nothing was written" in done.stderr
    assert "upper_plate/small_board_holder" in done.stderr
    assert "its nut is in the nut of S12 M3 x 8" in done.stderr
    assert {f: f.stat().st_mtime_ns for d in folders for f in d.iterdir()} == before
