"""Whose wheelbase and mass the verbs on recordings use: those of the named car, or a warning."""

from __future__ import annotations

from pathlib import Path

import pytest

from dart_hal.core.config import load_model
from dart_hal.core.config.folders import load_car
from dart_hal.vehicle.load import find_model
from dart_hal.vehicle.sizes import body_of, set_sizes
from tests.common import ROOT
from tests.recorded.simulated_recording import simulate_recording, table_of, write_table

LONG_CAR = {"wheelbase": 0.2, "l_f": 0.1, "l_r": 0.1, "mass": 2.0, "yaw_inertia": 0.01}
PUBLISHED = (ROOT / "tests" / "recorded" / "data" / "91_free_driving_16_sept_2024"
             / "car_1_Datarecording_09_16_2024_10_01_01.csv.gz")


@pytest.fixture(scope="module")
def own_recording(tmp_path_factory) -> Path:
    """A CSV file of a car that is not DART, turns to both sides."""
    folder = tmp_path_factory.mktemp("own")
    return write_table(table_of(simulate_recording(1, seconds=30.0)[0]), folder / "own.csv")


@pytest.fixture
def cars(tmp_path) -> Path:
    """A folder with the car ``long``."""
    text = (ROOT / "cars" / "dart-01" / "car.toml").read_text()
    lines = []
    for line in text.splitlines():
        key = line.partition("=")[0].strip()
        line = f"{key} = {LONG_CAR[key]}" if key in LONG_CAR else line
        lines.append('name = "long"' if key == "name" else line)
    folder = tmp_path / "cars" / "long"
    folder.mkdir(parents=True)
    (folder / "car.toml").write_text("\n".join(lines) + "\n")
    return folder.parent


def sizes_of(answer: dict) -> dict:
    return {key: answer["sizes"][key] for key in LONG_CAR}


@pytest.mark.parametrize("how", ["option", "environment", "folder of --out"])
@pytest.mark.slow_except("option")
def test_identify_writes_the_sizes_of_the_named_car(verb, own_recording, cars, monkeypatch, how):
    out = cars.parent / "model.toml"
    more = []
    if how == "option":
        more = ["--car", "long", "--cars", cars]
    elif how == "environment":
        monkeypatch.setenv("DART_HAL_CAR", "long")
        monkeypatch.setenv("DART_CARS", str(cars))
    else:
        out = cars / "long" / "model.toml"
    ran = verb("identify", "steering", "--json", own_recording, "--out", out, *more)
    assert sizes_of(ran.json) == LONG_CAR
    assert not ran.json["sizes"]["assumed"]
    assert "assumed" not in ran.err
    model = load_model(out)
    assert {key: model.body[key] for key in LONG_CAR} == LONG_CAR
    assert model.provenance["sizes"].startswith("car long")


@pytest.mark.slow
def test_sizes_that_are_assumed_follow_the_verdict(verb, own_recording):
    for words in (["evaluate", own_recording],
                  ["identify", "steering", own_recording, "--dry-run"]):
        line = verb(*words).out.splitlines()[3]
        assert line.startswith("assumed: wheelbase 0.175 m")
        assert "mass 1.67 kg" in line
        assert "--car NAME" in line


@pytest.mark.slow
def test_a_model_with_assumed_sizes_goes_on_saying_so(verb, own_recording, tmp_path):
    verb("identify", "steering", own_recording, "--out", "assumed.toml")
    ran = verb("evaluate", "--json", "--model", "assumed.toml", own_recording)
    assert ran.json["sizes"]["assumed"]
    printed = verb("evaluate", "--model", "assumed.toml", own_recording).out.splitlines()
    assert printed[3].startswith("assumed:")


@pytest.mark.slow
def test_nothing_is_assumed_of_a_published_recording(verb):
    ran = verb("evaluate", "--json", PUBLISHED)
    assert not ran.json["sizes"]["assumed"]
    assert sizes_of(ran.json)["wheelbase"] == 0.175


def test_evaluate_and_diagnose_take_the_sizes_of_the_named_car(verb, own_recording, cars):
    named = ("--car", "long", "--cars", cars)
    answer = verb("evaluate", "--json", *named, own_recording).json
    assert sizes_of(answer) == LONG_CAR
    assert answer["sizes"]["caution"] is None, "a car of 1:10, as the recording counts"


@pytest.mark.parametrize("line", ["", "front_share = 0.0", "front_share = 0.5"])
def test_all_wheel_drive_is_assumed_with_a_caution_alone(verb, own_recording, cars, line):
    described = cars / "long" / "car.toml"
    lines = [line if one.startswith("front_share") else one
             for one in described.read_text().splitlines()]
    described.write_text("\n".join(lines) + "\n")
    ran = verb("evaluate", "--json", "--car", "long", "--cars", cars, own_recording)
    caution = ran.json["sizes"]["caution"] or ""
    assert ("all-wheel drive is assumed, because car.toml of long" in caution) == (line == "")


@pytest.mark.slow
def test_recording_without_a_car_is_cautioned_with_a_model_of_a_larger_car(verb, own_recording,
                                                                             cars):
    described = cars / "long" / "car.toml"
    text = described.read_text().replace("mass = 2.0", "mass = 4.0")
    described.write_text(text.replace("yaw_inertia = 0.01", "yaw_inertia = 0.03"))
    ran = verb("evaluate", "--json", "--car", "long", "--cars", cars, own_recording)
    assert "limits of speed and length of a car of another size" in ran.json["sizes"]["caution"]
    assert "import or record them with --car" in ran.err


@pytest.mark.slow
def test_diagnose_takes_the_sizes_of_the_named_car(verb, own_recording, cars):
    named = ("--car", "long", "--cars", cars)
    found = verb("diagnose", "--json", "--train", own_recording, *named, "--max-causes", "0").json
    assert sizes_of(found) == LONG_CAR


@pytest.mark.slow
def test_a_model_file_that_contradicts_the_named_car_is_cautioned(verb, own_recording, cars):
    verb("identify", "steering", own_recording, "--out", "dart.toml", "--car", "dart-01", "--cars",
         ROOT / "cars")
    ran = verb("evaluate", "--json", "--model", "dart.toml", "--car", "long", "--cars", cars,
               own_recording)
    assert "wheelbase 0.175 m and not 0.2" in ran.json["sizes"]["caution"]
    assert "caution: dart.toml states other sizes" in ran.err
    same = verb("evaluate", "--json", "--model", "dart.toml", "--car", "dart-01", "--cars",
                ROOT / "cars", own_recording)
    assert same.json["sizes"]["caution"] is None


def test_a_car_that_does_not_exist_is_refused(verb, own_recording):
    for words in (["evaluate"], ["data", "check"], ["identify", "steering"],
                  ["diagnose", "--train"]):
        error = verb(*words, "--json" if words[0] != "diagnose" else own_recording, own_recording,
                     "--car",
                     "nowhere", *(["--json"] if words[0] == "diagnose" else [])).error
        assert "no car nowhere" in error["what"]


@pytest.mark.slow
def test_values_are_compared_with_the_base_that_was_used(verb, own_recording, tmp_path):
    base = tmp_path / "base.toml"
    text = (ROOT / "host" / "dart_hal" / "vehicle" / "published" / "paper.toml").read_text()
    base.write_text(text.replace('name = "paper"', 'name = "mine"').replace(
        "a_left_rad = ", "a_left_rad = 0.21 # "))
    ran = verb("identify", "steering", "--json", "--dry-run", "--base", base, own_recording)
    fit = ran.json["fits"]["steering"]
    assert fit["base"]["parameters"]["a_left_rad"] == pytest.approx(0.21)
    assert "paper" not in fit
    table = verb("identify", "steering", "--dry-run", "--base", base, own_recording).out
    assert "base" in table.partition("identifiable")[0].splitlines()[-1]
    other = verb("identify", "steering", "--json", "--dry-run",
                 own_recording).json["fits"]["steering"]
    assert other["base"]["parameters"]["a_left_rad"] == pytest.approx(0.330138, abs=1e-3)
    assert "paper" not in other


@pytest.mark.slow
def test_published_recordings_of_dart_are_compared_with_the_paper(verb):
    fit = verb("identify", "friction", "--json", "--dry-run", PUBLISHED).json["fits"]["friction"]
    assert fit["paper"]["parameters"]["a"] == find_model("paper")[1].friction.a
    assert "base" not in fit


def test_yaw_inertia_that_is_not_stated_scales_with_the_car(cars):
    path = cars / "long" / "car.toml"
    path.write_text("\n".join(line for line in path.read_text().splitlines()
                              if not line.startswith("yaw_inertia")))
    body = body_of(load_car("long", [cars]).config.geometry)
    dart = find_model("paper")[1].body
    shape = dart.yaw_inertia / (dart.mass * dart.l_f * dart.l_r)
    assert body.yaw_inertia == pytest.approx(shape * 2.0 * 0.1 * 0.1)


def test_a_mass_that_was_weighed_is_kept(cars, tmp_path):
    model = find_model("paper")[0]
    path = tmp_path / "weighed.toml"
    text = (ROOT / "host" / "dart_hal" / "vehicle" / "published" / "paper.toml").read_text()
    path.write_text(text.replace("mass = 1.67", "mass = { value = 1.71, std = 0.01 }"))
    weighed = load_model(path)
    size = load_car("long", [cars]).config.geometry
    assert set_sizes(weighed, size).body["mass"].value == 1.71
    assert set_sizes(model, size).body["mass"] == 2.0
