"""The finished car: parts mate, nothing overlaps, the lidar sees, mass as described."""

from __future__ import annotations

import functools
import importlib
import json
import math
import sys
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.common import HARDWARE, ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

sys.path.append(str(HARDWARE / "cad"))
collisions, parameters, probe, shapes = (importlib.import_module(n) for n in (
    "collisions", "parameters", "probe", "shapes"))
P = parameters.read()
BUILT = json.loads((HARDWARE / "cad" / "built.json").read_text(encoding="utf-8"))
PLACES = {q["name"]: q for q in BUILT["placements"]}


def place_part(name: str, shift: tuple[float, float, float] = (0, 0, 0)) -> trimesh.Trimesh:
    """A made part in the car, from its committed mesh."""
    body = trimesh.load_mesh(HARDWARE / "stl" / f"{PLACES[name]['part']}.stl")
    body.apply_transform(np.array(PLACES[name]["matrix"]))
    body.apply_translation(shift)
    return body


@functools.cache
def whole_car() -> dict[str, list[trimesh.Trimesh]]:
    """Bodies of each part in the car; loaded by the first test, not while tests are collected."""
    bought = {i["name"]: [shapes.body(s) for s in i["shapes"]] for i in BUILT["items"]}
    return bought | {name: [place_part(name)] for name in PLACES}


def screws(name: str, use: str) -> np.ndarray:
    """Axes of a placed part's holes with this use: positions in the car, shape (n, 3), mm."""
    matrix = np.array(PLACES[name]["matrix"])
    rows = [h["at"] for h in BUILT["parts"][PLACES[name]["part"]]["holes"]
            if use in h["use"].split(", ")]
    assert rows, f"{name} has no hole for {use}"
    return np.array(rows) @ matrix[:3, :3].T + matrix[:3, 3]


def hole_distance(a: np.ndarray, b: np.ndarray, axes: tuple[int, int]) -> float:
    """Largest distance [mm] from a hole of `a` to the nearest of `b`, along the screw."""
    near = [np.hypot(*(b[:, axes] - q[list(axes)]).T).min() for q in a]
    return float(max(near))


# What is screwed together: hole of one part, hole of the other, plane across the screw.
JOINTS = [
    ("base_plate", "jetson", "upper_plate", "jetson", (0, 1)),
    ("board_holder_left", "plate", "base_plate", "board_holder", (0, 1)),
    ("board_holder_right", "plate", "base_plate", "board_holder", (0, 1)),
    ("board_holder_left", "back_plate", "back_plate", "board_holder", (1, 2)),
    ("board_holder_right", "back_plate", "back_plate", "board_holder", (1, 2)),
    ("small_board_holder_left", "plate", "upper_plate", "small_board_holder", (0, 1)),
    ("small_board_holder_left", "back_plate", "back_plate", "small_board_holder", (1, 2)),
    ("small_board_holder_right", "back_plate", "back_plate", "small_board_holder", (1, 2)),
    ("lidar_mount", "lidar", "base_plate", "lidar", (0, 1)),
    ("nano_imu_mount", "imu", "base_plate", "imu", (0, 1)),
    ("nano_imu_mount", "base_plate", "base_plate", "nano_imu_mount", (0, 1)),
    ("camera_bracket", "upper_plate", "upper_plate", "camera_bracket", (0, 1)),
    ("cutoff_holder", "upper_plate", "upper_plate", "cutoff_holder", (0, 1)),
]


@pytest.mark.parametrize(("one", "use", "other", "its", "axes"), JOINTS)
def test_screws_pass_through_both_parts(one, use, other, its, axes):
    assert hole_distance(screws(one, use), screws(other, its), axes) < 0.05


def test_a_plate_laid_upside_down_is_found():
    """The control: base and upper plate share the Jetson's holes only the right way up."""
    flipped = screws("upper_plate", "jetson") * [1, -1, 1]
    assert hole_distance(screws("base_plate", "jetson"), flipped, (0, 1)) > 0.5


@pytest.mark.slow
def test_brackets_close_the_gap_between_the_plates():
    base_top = whole_car()["base_plate"][0].bounds[1][2]
    roof = whole_car()["upper_plate"][0].bounds[0][2]
    assert roof - base_top == pytest.approx(56.0, abs=0.01)
    low = screws("board_holder_left", "back_plate")[0][2] - base_top
    high = roof - screws("small_board_holder_left", "back_plate")[0][2]
    pitch = np.ptp(screws("back_plate", "board_holder")[:, 2])
    assert low + pitch + high == pytest.approx(56.0, abs=0.01)
    assert (low, pitch, high) == pytest.approx((10.0, 38.0, 8.0), abs=0.01)


def slot(body: trimesh.Trimesh, sheet: trimesh.Trimesh) -> float:
    """Free height of the camera bracket around the plate, measured in its mesh, mm."""
    middle = np.array([[P.upper.camera_x - 5.0, 0.0, sheet.bounds.mean(axis=0)[2]]])
    up, down = (probe.exits(body, middle, np.array([[0.0, 0.0, s]]))[0][0] for s in (1.0, -1.0))
    return float(up + down)


@pytest.mark.slow
def test_the_camera_slot_is_the_sheet_and_play():
    bracket = whole_car()["camera_bracket"][0]
    plate = whole_car()["upper_plate"][0]
    assert slot(bracket, plate) == pytest.approx(3.2, abs=0.01)
    assert P.sheet.thickness + P.sheet.slot_play == pytest.approx(3.2)
    narrow = bracket.copy()
    narrow.apply_scale([1, 1, 0.9])
    narrow.apply_translation([0, 0, 0.1 * 60.5])
    assert slot(narrow, plate) == pytest.approx(2.88, abs=0.01), "the control"


@pytest.mark.slow
def test_nothing_overlaps():
    """Every pair of bodies, made and bought, in the committed meshes; as in the table."""
    overlaps = collisions.overlaps(whole_car())
    found = {pair: v for pair, v in overlaps.items() if v > collisions.TOUCH}
    assert found == {}
    assert {p: v for p, v in BUILT["overlaps_mm3"].items() if v > collisions.TOUCH} == {}


@pytest.mark.parametrize(("name", "shift", "into"), [
    ("upper_plate", (0, 0, -1.0), "jetson"), ("upper_plate", (0, 0, -1.0), "camera_bracket"),
    ("camera_bracket", (-0.5, 0, 0), "upper_plate"), ("sensor_gate", (-4.0, 0, 0), "gear"),
    ("hall_holder", (4.0, 0, 0), "gear"), ("magnet_ring", (0, 2.0, 0), "gear"),
    ("nano_imu_mount", (4.0, 0, 0), "standoffs_lower"), ("lidar_mount", (0, 0, 2.0), "lidar"),
])
def test_a_part_out_of_place_is_found(name, shift, into):
    others = {into: whole_car()[into], name: [place_part(name, shift)]}
    if into == "jetson":  # the standoffs between them
        others = {into: whole_car()["standoffs_upper"], name: others[name]}
    assert max(collisions.overlaps(others).values(), default=0.0) > collisions.TOUCH


def view(car: dict[str, list[trimesh.Trimesh]]) -> dict[str, Any]:
    return collisions.lidar_view(car, (P.lidar.axis_x, 0.0), P.lidar.scan_z)


@pytest.mark.slow
def test_the_lidar_sees_all_but_the_listed_posts():
    """Behind it is the Jetson on its posts: known, and nothing else."""
    visible = view(whole_car())
    assert visible == BUILT["lidar"]
    assert set(visible["blocked_deg"]) <= {"jetson", "standoffs_lower"}
    assert visible["free_left_deg"] >= 115
    assert visible["free_right_deg"] <= -115
    low = {**whole_car(), "camera_bracket": [place_part("camera_bracket", (0, 0, -20))]}
    assert "camera_bracket" in view(low)["blocked_deg"], "the control"


def test_the_ports_of_the_jetson_are_reachable():
    """From behind they lie in the window of the back plate; a post there would hide one."""
    u0, u1, v0, v1 = P.back.window
    ports = [s for i in BUILT["items"] if i["name"] == "jetson" for s in i["shapes"]
             if s["kind"] == "box" and s["low"][0] == 15]
    assert len(ports) == 6
    for port in ports:
        assert u0 <= port["low"][1] <= port["high"][1] <= u1
        assert v0 <= port["low"][2] <= port["high"][2] <= v1


def test_usb_of_the_nano_is_open_to_the_front():
    """A plug of 11 x 8 x 20 mm before the socket touches nothing."""
    def find_touched(x: float) -> list[str]:
        plug = trimesh.creation.box(bounds=[[x, -61.25, 4.6], [x + 20, -50.25, 10.6]])
        return [name for name, bodies in whole_car().items()
                if name != "usb_nano"  # that plug itself
                and sum(collisions.shared(plug, body) for body in bodies) > collisions.TOUCH]

    assert find_touched(72.6) == []
    assert find_touched(35.0) == ["nano"], "the control"


def balance() -> tuple[float, np.ndarray]:
    """Mass [g] and centre [mm] of the committed meshes with the masses of the table."""
    total = 0.0
    moment = np.zeros(3)
    weighed = [(i["mass_g"], whole_car()[i["name"]]) for i in BUILT["items"]]
    weighed += [(BUILT["parts"][q["part"]]["mass_g"], whole_car()[q["name"]])
                for q in BUILT["placements"]]
    for mass, bodies in weighed:
        volume = sum(b.volume for b in bodies)
        total += mass
        moment += sum(mass * b.volume / volume * b.center_mass for b in bodies)
    return total, moment / total


def example_car() -> dict[str, float]:
    text = (ROOT / "cars" / "dart-01" / "car.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)["geometry"]


def test_mass_and_centre_of_mass_are_those_of_the_table():
    mass, centre = balance()
    assert mass == pytest.approx(BUILT["assembly"]["mass_g"], abs=0.05)
    assert centre == pytest.approx(BUILT["assembly"]["centre_mm"], abs=0.05)
    known = {"base_plate": 69, "upper_plate": 52, "back_plate": 49}  # g, plates of the car
    assert {n: BUILT["parts"][n]["mass_g"] for n in known} == pytest.approx(known, rel=0.12)


def mass_faults(mass_g: float, centre_x: float) -> list[str]:
    """Where the assembly is not the example car: mass 10 %, centre 10 mm. Most masses of bought
    parts are assumed and the chassis is what is left, so the mass proves little, the centre
    more."""
    car = example_car()
    axle = BUILT["assembly"]["rear_axle_x_mm"]
    found = []
    if not math.isclose(mass_g / 1000, car["mass"], rel_tol=0.10):
        found.append("mass")
    if abs((centre_x - axle) / 1000 - car["l_r"]) > 0.010:
        found.append("centre")
    return found


def test_the_assembly_weighs_like_the_example_car():
    mass, centre = balance()
    assert mass_faults(mass, centre[0]) == []
    assert mass_faults(mass + 300, centre[0]) == ["mass"], "the control"
    assert mass_faults(mass, centre[0] - 10) == ["centre"], "the control"
    assert abs(centre[1]) < 5.0
    assert BUILT["assembly"]["wheelbase_mm"] / 1000 == pytest.approx(
        example_car()["wheelbase"], rel=0.01)


def test_the_assembly_turns_like_the_example_car():
    """Yaw inertia within 40 %: the car's own figure is that of a plate, never measured."""
    assert BUILT["assembly"]["yaw_inertia_kg_m2"] == pytest.approx(
        example_car()["yaw_inertia"], rel=0.4)
