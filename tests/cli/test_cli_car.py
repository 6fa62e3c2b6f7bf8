"""``dart-hal car new``: a car.toml from sizes with their standard errors."""

from __future__ import annotations

import sys
from io import StringIO
from math import exp, log
from pathlib import Path
from statistics import mean, stdev

import pytest

from dart_hal.car import Car
from dart_hal.car.car import open_url
from dart_hal.core.config import load_car, load_model
from dart_hal.core.errors import ConfigError
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.new_car import SHAPE, SHAPE_STD
from studies.diagnosis.hidden_drive import Plan, write
from tests.common import ROOT

DART_01 = ROOT / "cars" / "dart-01" / "car.toml"
PAGE = ROOT / "docs" / "reference" / "car-files.md"
SIZE_OPTIONS = {"--wheelbase": "0.325+-0.002", "--mass": "3.5+-0.02", "--l-f": "0.158+-0.003",
         "--max-steering": "0.38+-0.02"}


def options(changed: dict[str, str | None]) -> list[str]:
    sizes = {**SIZE_OPTIONS, **changed}
    return [word for key, size in sizes.items() if size is not None for word in (key, size)]


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    (tmp_path / "cars").mkdir()
    monkeypatch.delenv("DART_CARS", raising=False)
    monkeypatch.setattr(sys, "stdin", StringIO())  # a script: no answer


def test_car_is_written_with_its_errors_and_read_again(verb):
    ran = verb("car", "new", "zheng", *options({}))
    assert ran.code == 0, ran.err
    assert "written: cars/zheng/car.toml" in ran.out
    assert "next: dart-hal identify all --joint --car zheng --out cars/zheng/model.toml" in ran.err
    car = load_car("zheng")
    body = car.config.geometry
    assert (body.wheelbase, body.l_f, body.mass) == (0.325, 0.158, 3.5)
    assert body.l_r == pytest.approx(0.167)
    assert body.std.to_dict() == {"wheelbase": 0.002, "l_f": 0.003, "mass": 0.02,
                                 "yaw_inertia": pytest.approx(0.31 * body.yaw_inertia, rel=0.02)}
    assert car.config.limits.max_steering == 0.38
    assert car.config.encoder.metres_per_edge is None


@pytest.mark.parametrize(("drive", "share"), [("all", 0.5), ("front", 1.0), ("rear", 0.0),
                                              (None, None)])
def test_driven_axle_is_written_or_left_open(verb, drive, share):
    ran = verb("car", "new", "zheng", *options({"--drive": drive}))
    assert ran.code == 0, ran.err
    assert load_car("zheng").config.geometry.front_share == share
    assert ("all-wheel drive is assumed" in ran.out) == (drive is None)


def test_older_drive_stays_unless_it_is_named(verb):
    for drive, share in (("rear", 0.0), (None, 0.0), ("front", 1.0)):
        assert verb("car", "new", "zheng", *options({"--drive": drive})).code == 0
        assert load_car("zheng").config.geometry.front_share == share


@pytest.mark.parametrize(("wheelbase", "mass", "l_f"), [
    (0.06, 0.04, 0.029), (0.062, 0.041, 0.029), (0.57, 21.8, 0.34), (2.6, 1000.0, 1.2)],
    ids=["40 g", "41 g", "21.8 kg", "1 t"])
def test_cars_of_all_scales_are_written(verb, wheelbase, mass, l_f):
    ran = verb("car", "new", "any", "--json", *options({
        "--wheelbase": f"{wheelbase}+-{0.01 * wheelbase}", "--mass": f"{mass}+-{0.01 * mass}",
        "--l-f": f"{l_f}+-{0.02 * l_f}"}))
    assert ran.code == 0, ran.err
    assert ran.json["sizes"]["mass"]["value"] == mass
    assert ran.json["estimated"] == ["yaw_inertia"]
    assert load_car("any").config.geometry.mass == mass


def test_shape_of_the_yaw_inertia_is_that_of_the_cars_in_the_handbook():
    rows = [line.split("|")[1:-1] for line in PAGE.read_text().splitlines()
            if line.startswith("|") and line.count("|") == 6]
    shapes = []
    for _, mass, lengths, inertia, stated in rows[2:]:
        front, rear = map(float, lengths.split(","))
        shape = float(inertia) / (float(mass) * front * rear)
        assert shape == pytest.approx(float(stated), abs=0.006)
        shapes.append(log(shape))
    assert len(shapes) == 6
    assert exp(mean(shapes)) == pytest.approx(SHAPE, abs=0.006)
    assert stdev(shapes) == pytest.approx(SHAPE_STD, abs=0.006)


def test_axle_loads_give_mass_and_centre_of_mass(verb):
    ran = verb("car", "new", "scales", "--json", *options({
        "--l-f": None, "--mass": None, "--front-load": "2.0+-0.02", "--rear-load": "1.5+-0.02"}))
    sizes = ran.json["sizes"]
    assert sizes["mass"] == {"value": 3.5, "std": pytest.approx(0.02 * 2**0.5)}
    assert sizes["l_f"]["value"] == pytest.approx(0.325 * 1.5 / 3.5)
    assert sizes["l_f"]["std"] == pytest.approx(
        ((0.325 * (2.0**2 + 1.5**2)**0.5 * 0.02 / 3.5**2)**2 + (1.5 / 3.5 * 0.002)**2)**0.5)


def test_yaw_inertia_that_was_measured_is_not_estimated(verb):
    ran = verb("car", "new", "swing", "--json", *options({"--yaw-inertia": "0.05+-0.004"}))
    assert ran.json["estimated"] == []
    assert ran.json["sizes"]["yaw_inertia"] == {"value": 0.05, "std": 0.004}


@pytest.mark.parametrize(("changed", "words"), [
    ({"--mass": "3500+-20"}, "kg per cubic metre"),
    ({"--wheelbase": "325+-2", "--l-f": "158+-3"}, "geometry.wheelbase"),
    ({"--max-steering": "22+-1"}, "limits.max_steering"),
    ({"--l-f": "0.4+-0.01"}, "not between the axles"),
    ({"--wheelbase": "0.325+-0.2"}, "geometry.std.wheelbase"),
    ({"--yaw-inertia": "500+-50"}, "times m l_f l_r"),
    ({"--mass": "4.0+-0.02", "--l-f": None, "--front-load": "2.0+-0.02",
      "--rear-load": "1.5+-0.02"}, "do not add up"),
    ({"--front-load": "2.0+-0.02"}, "both axle loads"),
    ({"--l-r": "0.16+-0.01"}, "both axle loads"),
    ({"--mass": None}, "a size is missing"),
    ({"--max-steering": None}, "a size is missing")])
def test_sizes_that_no_car_has_are_refused(verb, changed, words):
    error = verb("car", "new", "bad", "--json", *options(changed)).error
    assert words in " ".join(map(str, error.values()))
    assert not Path("cars/bad").exists()


@pytest.mark.parametrize("text", ["0.325", "-0.3+-0.01", "0.3+--0.01", "0.3+-0", "nan+-0.01",
                                  "0.3+-inf", "+-", "0.3 m+-1 mm", ""])
def test_number_without_a_sound_error_is_refused(verb, text):
    error = verb("car", "new", "bad", "--json", *options({"--wheelbase": text})).error
    assert "--wheelbase" in error["what"]


@pytest.mark.parametrize("name", ["a/b", "..", "", " ", "a\nb", "x" * 65, "a;b"])
def test_name_that_is_no_folder_is_refused(verb, name):
    assert "name" in verb("car", "new", "--json", name, *options({})).error["what"]
    assert not list(Path("cars").iterdir())


def test_older_version_goes_to_history_with_a_notice(verb):
    verb("car", "new", "twice", *options({}))
    first = Path("cars/twice/car.toml").read_text()
    assert "estimated" in first
    ran = verb("car", "new", "twice", *options({"--yaw-inertia": "0.05+-0.004"}))
    assert "notice: cars/twice/car.toml was there" in ran.err
    assert Path("cars/twice/history/car-0001.toml").read_text() == first
    assert "estimated" not in Path("cars/twice/car.toml").read_text()


def test_other_keys_of_an_existing_car_stay(verb):
    old = Path("cars/mine/car.toml")
    old.parent.mkdir()
    old.write_text(DART_01.read_text().replace('name = "dart-01"', 'name = "mine"'))
    before = load_car("mine").config
    assert verb("car", "new", "mine", *options({})).code == 0
    after = load_car("mine").config
    assert after.geometry.mass == 3.5
    assert after.geometry.wheel_radius == before.geometry.wheel_radius
    assert (after.encoder, after.pwm, after.steering) == (before.encoder, before.pwm,
                                                          before.steering)
    assert "# axle to axle" in old.read_text()


def test_broken_car_file_is_not_replaced(verb):
    old = Path("cars/mine/car.toml")
    old.parent.mkdir()
    old.write_text("geometry = 3\n")
    assert "car.toml" in verb("car", "new", "mine", "--json", *options({})).error["what"]
    assert old.read_text() == "geometry = 3\n"


def test_what_is_missing_is_requested_at_the_terminal(verb, monkeypatch):
    class CarTerminal(StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdin", CarTerminal(
        "0.325\n0.325+-0.002\n2.0+-0.02\n1.5+-0.02\n\n0.38+-0.02\nrear\n"))
    ran = verb("car", "new", "prompted")
    assert ran.code == 0, ran.err
    assert "VALUE+-STD" in ran.err
    geometry = load_car("prompted").config.geometry
    assert (geometry.mass, geometry.front_share) == (3.5, 0.0)


@pytest.mark.slow
def test_joint_fit_moves_the_sizes_and_states_where_they_are_from(verb, tmp_path):
    drive = write(tmp_path / "drive.csv", PAPER, 21, Plan(seconds=30.0))
    verb("car", "new", "plate", *options({
        "--wheelbase": "0.175+-0.002", "--mass": "1.67+-0.02", "--l-f": "0.0805+-0.002",
        "--yaw-inertia": "0.0065+-0.0006"}))
    words = ("identify", "all", "--joint", "--car", "plate", "--out", "cars/plate/model.toml",
             drive)
    ran = verb(*words)
    assert "sizes of car.toml: wheelbase 0.175 +- 0.002 -> " in " ".join(ran.out.split())
    body = load_model("cars/plate/model.toml").body
    for key, std in (("wheelbase", 0.002), ("l_f", 0.002), ("mass", 0.02),
                     ("yaw_inertia", 0.0006)):
        assert body[key].method == "car.toml, joint fit"
        assert 0.0 < body[key].std < 1.2 * std
        assert abs(body[key].value - getattr(PAPER.body, key)) < 3.0 * std
    assert body["l_r"] == pytest.approx(body["wheelbase"].value - body["l_f"].value)
    again = verb(*words, "--dry-run")
    assert "wheelbase 0.175 +- 0.002 -> " in " ".join(again.out.split()), "car.toml is the prior"


def test_car_without_an_encoder_cannot_be_opened(verb):
    verb("car", "new", "recorded", *options({}))
    backend = open_url("sim://?nano=mock")
    backend.car_toml = backend.car = None  # a real car: the files are those of the folder
    with pytest.raises(ConfigError, match=r"encoder\.metres_per_edge is missing") as refused:
        Car.over(backend, car="recorded")
    assert "cars/recorded/car.toml" in str(refused.value)
