"""Every refusal of a car's file names the file, the key and a remedy."""

from __future__ import annotations

import pytest

from dart_hal.core.config import load_car, parse_calibration, parse_config, parse_model
from dart_hal.core.errors import ConfigError, NotMonotone, OtherCar
from dart_hal.vehicle.load import find_model

CAR_TEXT = """
name = "a"
geometry = {{ wheelbase = 0.175, l_f = 0.0805, l_r = 0.0945, mass = 1.67 }}
encoder = {{ metres_per_edge = {{ value = 0.002, std = 1e-5 }} }}
{}
"""
MAP_TEXT = 'car = "a"\n[steering.map]\npulse_us = {}\nangle_rad = {}\nstd_rad = [0.1, 0.1, 0.1]'


def read_refused(read, text: str, kind: type[ConfigError] = ConfigError) -> ConfigError:
    with pytest.raises(kind) as caught:
        read(text)
    assert "file.toml" in caught.value.what
    assert caught.value.read == "file.toml"
    assert caught.value.remedy
    return caught.value


def car(text: str) -> object:
    return parse_config(CAR_TEXT.format(text), "file.toml")


def calibration(text: str) -> object:
    return parse_calibration(text, "file.toml", "a")


def test_the_base_text_of_these_tests_is_accepted() -> None:
    car("")
    calibration('car = "a"')
    calibration(MAP_TEXT.format("[1001, 1002, 1003]", "[0.3, 0.2, 0.1]"))


@pytest.mark.parametrize(("line", "key", "suggestion"), [
    ("[pwm]\nadress = 64", "adress", "address"),
    ("[steering]\ncenter = 1500", "center", "center_us"),
    ("[limits]\nmax_steer = 0.3", "max_steer", "max_steering"),
    ("[safty]\ncutoff_required = true", "safty", "safety"),
])
def test_an_unknown_key_is_refused_with_the_nearest_that_exists(line, key, suggestion) -> None:
    error = read_refused(car, line)
    assert error.found == key
    assert suggestion in error.expected
    assert suggestion in error.remedy


@pytest.mark.parametrize(("line", "key"), [
    ("[pwm]\naddress = 60", "pwm.address"),                 # decimal 60 for 0x40
    ("[pwm]\naddress = 'x'", "pwm.address"),
    ("[pwm]\nfrequency = nan", "pwm.frequency"),
    ("[steering]\ndirection = 2", "steering.direction"),
    ("[steering]\nspan_us = -375", "steering.span_us"),
    ("[throttle]\nchannel = 0", "throttle.channel"),
    ("[throttle]\nneutral_us = 150", "throttle.neutral_us"),
    ("[limits]\nmax_throttle = 1.5", "limits.max_throttle"),
    ("[limits]\nsteering_slew = inf", "limits.steering_slew"),
    ("[lidar]\nscale = 1.5", "lidar.scale"),
    ("[encoder]\nrings = 3", "encoder"),
])
def test_a_value_out_of_range_is_refused_by_its_key(line, key) -> None:
    text = CAR_TEXT.format(line)
    if line.startswith("[encoder]"):
        text = text.replace("encoder = {", "#")
    error = read_refused(lambda t: parse_config(t, "file.toml"), text)
    assert key in str(error)


@pytest.mark.parametrize(("std", "key"), [
    ("mass = 0", "geometry.std.mass"), ("mass = -0.1", "geometry.std.mass"),
    ("mass = nan", "geometry.std.mass"), ("mass = 20.0", "geometry.std.mass"),
    ("wheelbase = 2.0", "geometry.std.wheelbase"), ("weight = 0.1", "weight"),
    ("yaw_inertia = 0.001", "geometry.std.yaw_inertia"),
    ("l_f = 0.001, l_r = 0.001", "geometry.std.l_r")])
def test_standard_error_of_a_size_that_cannot_be_is_refused(std, key) -> None:
    text = CAR_TEXT.format("").replace("mass = 1.67", f"mass = 1.67, std = {{ {std} }}")
    assert "std" in text
    assert key in read_refused(lambda t: parse_config(t, "file.toml"), text).what


def test_axles_that_do_not_add_up_to_the_wheelbase_are_refused() -> None:
    text = CAR_TEXT.format("").replace("0.0945", "0.0845")
    assert "wheelbase" in read_refused(lambda t: parse_config(t, "file.toml"), text).what


@pytest.mark.parametrize("entry", ["25_100_000", "{ value = 25_100_000 }", "{ std = 3 }",
                                   "{ value = 25e6, std = -1 }", "{ value = 25e6, std = nan }"])
def test_a_measured_value_without_an_honest_std_is_refused(entry) -> None:
    error = read_refused(calibration, f'car = "a"\n[pwm]\noscillator_hz = {entry}')
    assert "pwm.oscillator_hz" in error.what


def test_a_map_without_stds_is_refused() -> None:
    text = MAP_TEXT.format("[1, 2, 3]", "[1, 2, 3]").rpartition("\n")[0]
    assert "standard error" in read_refused(calibration, text).what


@pytest.mark.parametrize(("pulse", "angle"), [
    ("[1, 3, 2]", "[1, 2, 3]"), ("[1, 2, 3]", "[1, 3, 2]"), ("[1, 2, 3]", "[3, 1, 2]"),
    ("[1, 2, 3]", "[1, 1, 2]"), ("[3, 2, 1]", "[1, 2, 3]")])
def test_a_map_that_turns_back_is_refused(pulse, angle) -> None:
    assert "turns back" in read_refused(calibration, MAP_TEXT.format(pulse, angle),
                                        NotMonotone).what


def test_a_map_of_unequal_columns_is_refused() -> None:
    assert "angle_rad" in read_refused(calibration, MAP_TEXT.format("[1, 2, 3]", "[1, 2]")).what


@pytest.mark.parametrize(("speed", "pulse", "std", "key"), [
    ("[0.5]", "[1600]", "[0.2]", "drive.speed"),
    ("[0.5, 1.0]", "[1600]", "[0.2, 0.2]", "drive.pulse_us"),
    ("[0.5, 1.0]", "[1600, 1610]", "[0.2, 0.0]", "drive.std_us"),
    ("[-0.5, 1.0]", "[1600, 1610]", "[0.2, 0.2]", "drive.speed"),
    ("[0.5, 1.0]", "[0.16, 0.17]", "[0.2, 0.2]", "drive.pulse_us")])
def test_a_drive_table_that_cannot_be_is_refused_by_its_key(speed, pulse, std, key) -> None:
    text = f'car = "a"\n[throttle.drive]\nspeed = {speed}\npulse_us = {pulse}\nstd_us = {std}'
    assert key in read_refused(calibration, text).what


def test_a_drive_table_that_turns_back_is_refused() -> None:
    text = ('car = "a"\n[throttle.drive]\nspeed = [0.5, 1.0]\npulse_us = [1610, 1600]\n'
            'std_us = [1, 1]')
    assert "drive.pulse_us" in read_refused(calibration, text, NotMonotone).what


def test_a_neutral_that_is_no_pulse_and_a_behaviour_that_is_none_are_refused() -> None:
    neutral = 'car = "a"\n[throttle]\nneutral_us = { value = 1.5, std = 0.001 }'
    assert "throttle.neutral_us" in read_refused(calibration, neutral).what
    assert "reverse" in read_refused(calibration, 'car = "a"\n[throttle]\nreverse = "maybe"').what


def test_another_cars_calibration_is_refused() -> None:
    error = read_refused(calibration, 'car = "b"', OtherCar)
    assert (error.found, error.expected) == ("b", "a")


def test_a_file_of_another_kind_is_refused_before_its_keys_confuse() -> None:
    error = read_refused(calibration, 'schema = "dart-hal/model/1"\nname = "x"')
    assert "calibration/1" in error.expected


def test_a_ring_whose_intervals_do_not_sum_to_their_number_is_refused() -> None:
    text = 'car = "a"\n[encoder]\nring = {{ value = [1.0, {}], std = 0.01 }}'
    calibration(text.format("1.0"))
    assert "ring" in read_refused(calibration, text.format("1.1")).what


def test_a_model_with_an_unknown_parameter_is_refused() -> None:
    text = 'name = "m"\nkind = "dynamic"\n[body]\nwheelbase = 0.2\n[friction]\n{} = 1.0'
    parse_model(text.format("a"), "file.toml")
    error = read_refused(lambda t: parse_model(t, "file.toml"), text.format("A"))
    assert "[friction]" in error.what


@pytest.mark.parametrize(("names", "matrix", "word"), [
    ("a, c", "[[1.0, 0.5], [0.5, 1.0]]", None),
    ("a, c", "[[1e-8, 9.99999e-5], [9.99999e-5, 1.0]]", None),
    ("a, x", "[[1.0, 0.5], [0.5, 1.0]]", "friction.x"),
    ("a, a", "[[1.0, 0.5], [0.5, 1.0]]", "names is out of range"),
    ("a, c", "[[1.0, 0.5]]", "2 x 2"),
    ("a, c", "[[1.0, 0.5], [0.4, 1.0]]", "no covariance"),
    ("a, c", "[[1.0, 1.1], [1.1, 1.0]]", "no covariance"),
    ("a, c", "[[-1.0, 0.0], [0.0, 1.0]]", "no covariance"),
    ("a, b, c", "[[1.0, -0.9, -0.9], [-0.9, 1.0, -0.9], [-0.9, -0.9, 1.0]]", "no covariance")])
def test_a_covariance_that_cannot_be_is_refused(names, matrix, word) -> None:
    listed = ", ".join(f'"friction.{name}"' for name in names.split(", "))
    text = ('name = "m"\nkind = "dynamic"\n[body]\nwheelbase = 0.2\n[friction]\na = 1.0\nb = 2.0\n'
            f'c = 1.0\n[covariance.joint]\nnames = [{listed}]\nmatrix = {matrix}\n')
    if word is None:
        parse_model(text, "file.toml")
    else:
        error = read_refused(lambda t: parse_model(t, "file.toml"), text)
        assert word in error.what + error.found


def test_broken_toml_is_refused_with_its_file() -> None:
    read_refused(lambda t: parse_config(t, "file.toml"), "[pwm\n")


def test_an_unknown_car_lists_those_that_exist(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("DART_CARS", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    (tmp_path / "cars" / "a").mkdir(parents=True)
    (tmp_path / "cars" / "a" / "car.toml").write_text(CAR_TEXT.format(""), encoding="utf-8")
    assert load_car("a").config.name == "a"
    with pytest.raises(ConfigError) as caught:
        load_car("b")
    assert "cars a" in caught.value.found


MODEL = """
name = "m"
kind = "dynamic"
[body]
wheelbase = 0.175
l_f = 0.0805
l_r = 0.0945
mass = 1.67
yaw_inertia = 0.0065
"""


@pytest.mark.parametrize(("old", "new", "key", "found", "expected"), [
    ('"dynamic"', '"dynmic"', "kind", "'dynmic'", "one of kinematic, dynamic"),
    ("1.67", '"heavy"', "body.mass", "'heavy'", "a number, or {"),
    ("1.67", "true", "body.mass", "True", "a number, or {"),
    ("1.67", '{ value = "x", std = 1.0 }', "body.mass.value", "'x'", "a number"),
    ("1.67", "{ value = 1.67 }", "body.mass", "{'value': 1.67}", "std"),
    ('"m"', "3", "name", "3", "text")])
def test_the_entry_of_a_model_that_is_wrong_is_named(old, new, key, found, expected) -> None:
    parse_model(MODEL, "file.toml")
    error = read_refused(lambda t: parse_model(t, "file.toml"), MODEL.replace(old, new))
    assert f"{key} " in error.what
    assert error.found == found
    assert expected in error.expected
    assert "[...]" not in str(error)


def test_a_choice_that_was_misspelt_is_spelt_out() -> None:
    error = read_refused(lambda t: parse_model(t, "file.toml"), MODEL.replace("dynamic", "dynmic"))
    assert error.remedy == "write dynamic for dynmic"
    assert read_refused(car, "[steering]\ndirection = 2").expected == "one of -1, 1"


@pytest.mark.parametrize(("old", "new"), [("0.0945", "0.1945"), ("1.67", "-1.0")])
def test_laws_of_the_vehicle_name_the_file(tmp_path, old, new) -> None:
    path = tmp_path / "model.toml"
    path.write_text(MODEL.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        find_model(path)
    assert caught.value.what.startswith(f"{path}: ")
    assert caught.value.read == str(path)
