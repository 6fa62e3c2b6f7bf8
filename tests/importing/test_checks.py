"""Wrong signs, units, axes and clocks are found, and right ones are not blamed."""

from __future__ import annotations

import re

import numpy as np
import pytest

from dart_hal.core.errors import ConfigError, RecordingError
from dart_lab.importing import check_data, convert_tables, guess_map, read_tables
from dart_lab.importing.maps import Column, column_of, parse_map
from dart_lab.importing.tables import Table
from tests.importing.logs import MAP, make_log, write_csv

DEG = np.pi / 180.0
KMH = 1.0 / 3.6
G = 9.80665


@pytest.fixture(scope="module")
def log():
    return make_log(40.0)


def find(columns, text=MAP):
    return check_data(convert_tables([Table("log", columns)], parse_map(text, "map")))


def without_sensors(text=MAP):
    return text[:text.index("[encoder]")]


def shift(values, rows):
    return np.concatenate([np.full(rows, values[0]), values[:-rows]])


@pytest.mark.slow_except("1")
@pytest.mark.parametrize("seed", range(4))
def test_a_right_log_has_no_contradiction(seed):
    findings = find(make_log(40.0, seed))
    assert {f.what for f in findings} == {"yaw", "gyro", "encoder", "accelerometer", "steering",
                                          "throttle"}
    assert not [str(f) for f in findings if f.remedy]


@pytest.mark.parametrize(("change", "what", "remedy"), [
    (lambda c: {"steering": -c["steering"]}, "steering", "[steering] needs sign = -1"),
    (lambda c: {"throttle": -c["throttle"]}, "throttle", "[throttle] needs sign = -1"),
    (lambda c: {"yaw": -c["yaw"]}, "yaw", "yaw of [poses] needs sign = -1"),
    (lambda c: {"y": -c["y"]}, "yaw", "y of [poses] needs sign = -1"),
    (lambda c: {"x": c["y"], "y": c["x"]}, "yaw", "exchange the columns x and y"),
    (lambda c: {"yaw": np.rad2deg(np.unwrap(c["yaw"]))}, "yaw", 'needs unit = "deg"'),
    (lambda c: {"yaw": np.deg2rad(np.unwrap(c["yaw"]))}, "yaw", 'needs unit = "rad"'),
    (lambda c: {"yaw": c["yaw"] + 1.5708}, "yaw", "zero = 1.57"),
    (lambda c: {"x": 1e3 * c["x"], "y": 1e3 * c["y"]}, "poses", 'need unit = "mm"'),
    (lambda c: {"x": 1e3 * c["x"], "y": 1e3 * c["y"], "speed": 3.6 * c["speed"]}, "poses",
     'need unit = "mm"'),
    (lambda c: {"x": 1e2 * c["x"], "y": 1e2 * c["y"], "speed": 3.6 * c["speed"]}, "poses",
     'need unit = "cm"'),
    (lambda c: {"x": 30.0 * c["x"], "y": 30.0 * c["y"], "speed": 1.08 * c["speed"]}, "poses",
     'x and y of [poses] need unit = "cm", and speed of [encoder] needs unit = "km/h"'),
    (lambda c: {"yaw_rate": -c["yaw_rate"]}, "gyro", "[gyro] needs sign = -1"),
    (lambda c: {"yaw_rate": np.rad2deg(c["yaw_rate"])}, "gyro", 'needs unit = "deg/s"'),
    (lambda c: {"speed": 3.6 * c["speed"]}, "encoder", 'needs unit = "km/h"'),
    (lambda c: {"speed": 1.7 * c["speed"]}, "encoder", "needs scale = 0.58"),
    (lambda c: {"yaw_rate": np.repeat(c["yaw_rate"][::5], 5)}, "gyro", "changes ="),
    (lambda c: {"accel_y": -c["accel_y"]}, "accelerometer", "y of [accelerometer] needs sign"),
    (lambda c: {"accel_y": c["accel_y"] / 9.80665}, "accelerometer", 'needs unit = "g"'),
    (lambda c: {"accel_x": c["accel_y"], "accel_y": -c["accel_x"]}, "accelerometer",
     "exchange the columns x and y of [accelerometer]; x then needs sign = -1"),
    (lambda c: {"accel_x": -c["accel_y"], "accel_y": c["accel_x"]}, "accelerometer",
     "exchange the columns x and y of [accelerometer]; y then needs sign = -1"),
    (lambda c: {"yaw_rate": shift(c["yaw_rate"], 40)}, "gyro", "needs delay = 0.4"),
    (lambda c: {"speed": shift(c["speed"], 70)}, "encoder", "needs delay = 0.7")])
def test_each_mistake_is_named_with_its_remedy(log, change, what, remedy):
    found = {f.what: f for f in find({**log, **change(log)}) if f.remedy}
    assert remedy in found[what].remedy
    assert list(found) == [what]


@pytest.mark.parametrize("rows", [3990, 3800, 3411])
def test_a_log_that_ends_while_the_car_drives_has_one_clock(log, rows):
    found = " ".join(map(str, find({name: values[:rows] for name, values in log.items()})))
    assert "needs delay" not in found


@pytest.mark.parametrize(("change", "what", "remedy"), [
    (lambda c: {"y": -c["y"]}, "yaw", "y of [poses] needs sign = -1"),
    (lambda c: {"yaw": -c["yaw"]}, "yaw", "yaw of [poses] needs sign = -1"),
    (lambda c: {"steering": -c["steering"]}, "steering", "[steering] needs sign = -1")])
def test_poses_and_commands_alone_show_their_mistakes(log, change, what, remedy):
    found = {f.what: f for f in find({**log, **change(log)}, without_sensors()) if f.severe}
    assert remedy in found[what].remedy


def test_a_guess_takes_the_units_from_the_names(log):
    scales = {"time_ms": ("t", 1e-3), "pos_x_mm": ("x", 1e-3), "pos_y_mm": ("y", 1e-3),
              "heading_deg": ("yaw", np.pi / 180.0), "cmd_steer_pct": ("steering", 0.01),
              "cmd_throttle_pct": ("throttle", 0.01), "wheel_speed_kmh": ("speed", 1.0 / 3.6),
              "gyro_z_dps": ("yaw_rate", np.pi / 180.0)}
    guess = guess_map([Table("log", {name: log[key] / unit
                                     for name, (key, unit) in scales.items()})])
    assert column_of(guess.map.poses.y) == Column(column="pos_y_mm", unit="mm")
    assert column_of(guess.map.encoder.speed) == Column(column="wheel_speed_kmh", unit="km/h")
    assert column_of(guess.map.gyro.yaw_rate) == Column(column="gyro_z_dps", unit="deg/s")
    assert (guess.map.steering.kind, guess.map.throttle.kind) == ("command", "duty")
    assert column_of(guess.map.steering.value).unit == "%"
    assert [q.partition(":")[0] for q in guess.questions] == ["throttle"]


@pytest.mark.parametrize("names", [
    {"Zeit [ms]": ("t", 1e-3), "X mm": ("x", 1e-3), "Y mm": ("y", 1e-3), "Yaw °": ("yaw", DEG),
     "v km/h": ("speed", KMH), "gyr_z °/s": ("yaw_rate", DEG), "ax g": ("accel_x", G),
     "ay g": ("accel_y", G)},
    {"ms": ("t", 1e-3), "x_mm": ("x", 1e-3), "y_mm": ("y", 1e-3), "heading_deg": ("yaw", DEG),
     "wheel_mm_s": ("speed", 1e-3), "gyro_z_deg_s": ("yaw_rate", DEG),
     "acc_x_m_s2": ("accel_x", 1.0), "acc_y_m_s2": ("accel_y", 1.0)},
    {"t": ("t", 1.0), "posX[cm]": ("x", 1e-2), "posY[cm]": ("y", 1e-2), "theta": ("yaw", 1.0),
     "wheel speed (cm/s)": ("speed", 1e-2), "w_z": ("yaw_rate", 1.0),
     "a_x (m/s²)": ("accel_x", 1.0), "a_y (m/s²)": ("accel_y", 1.0)}],
    ids=["with a space", "with underscores", "in brackets"])
def test_a_guess_reads_names_as_people_write_them(log, names):
    columns = {name: log[key] / unit for name, (key, unit) in names.items()}
    table = Table("log", {**columns, "steering": log["steering"], "throttle": log["throttle"]})
    data = convert_tables([table], guess_map([table]).map)
    expected = convert_tables([Table("log", log)], parse_map(MAP, "map"))
    for name, stream in expected.streams.items():
        assert data.streams[name].values == pytest.approx(stream.values, abs=1e-6), name


def test_pulses_beyond_the_usual_range_still_show_a_reversed_sign(log):
    columns = {**log, "steering": 1500.0 - 400.0 * log["steering"],
               "throttle": 1500.0 + 1600.0 * log["throttle"]}
    guess = guess_map([Table("log", columns)]).map
    assert (guess.steering.full_scale, column_of(guess.steering.value).sign) == (4e-4, -1)
    assert guess.throttle.full_scale == pytest.approx(6e-4, abs=5e-5)


@pytest.mark.slow
def test_the_proposed_map_undoes_what_was_done_to_the_log(log):
    columns = {"time [ms]": 1e3 * log["t"], "pos_x": log["x"], "pos_y": -log["y"],
               "heading_deg": np.rad2deg(log["yaw"]), "steer_cmd": -log["steering"],
               "throttle_cmd": log["throttle"], "wheel_speed": 3.6 * log["speed"],
               "gyro_z": np.rad2deg(log["yaw_rate"]), "acc_x": log["accel_x"],
               "acc_y": log["accel_y"] / 9.80665, "battery": np.full(len(log["t"]), 7.4)}
    guess = guess_map([Table("log", columns)])
    data = convert_tables([Table("log", columns)], parse_map(guess.text, "guess"))
    expected = convert_tables([Table("log", log)], parse_map(MAP, "map"))
    for name, stream in expected.streams.items():
        got = data.streams[name].values
        if name == "accelerometer":  # the data show the unit of the second axis alone
            got, want = got[:, 1], stream.values[:, 1]
        else:
            want = stream.values
        assert data.streams[name].t == pytest.approx(stream.t)
        assert got == pytest.approx(want, abs=1e-6), name


@pytest.mark.parametrize(("name", "volt", "unit"), [
    ("battery_voltage", 7.6, "V"), ("vbat_mV", 7600.0, "mV"), ("v_in", 15.8, "V"),
    ("Battery V", 11.1, "V"), ("motor_voltage", 7.6, None), ("cell_voltage[0]", 3.8, None),
    ("servo_in", 7.6, None), ("battery_voltage", 0.8, None), ("battery_percent", 40.0, None)])
def test_a_guess_recognises_the_voltage_of_the_battery(log, name, volt, unit):
    made = guess_map([Table("log", {**log, name: np.full(len(log["t"]), volt)})])
    assert (made.map.battery is None) == (unit is None)
    if unit is not None:
        assert column_of(made.map.battery.voltage) == Column(column=name, unit=unit)
        assert f"median is {volt:.4g} {unit}" in made.text


def test_a_guess_names_the_line_that_makes_a_column_text(log, tmp_path):
    path = write_csv(tmp_path / "log.csv", log)
    lines = path.read_text().splitlines()
    lines[51] = lines[51].replace(lines[51].split(",")[1], "n/a", 1)
    path.write_text("\n".join(lines))
    questions = " ".join(guess_map(read_tables([path])).questions)
    assert "column 'x' is not used, because line 52 has 'n/a'" in questions
    assert "is not used" not in " ".join(guess_map([Table("log", log)]).questions)


@pytest.mark.filterwarnings("error")
def test_a_guess_names_the_columns_without_a_number(log):
    empty = {name: np.full(len(log["t"]), np.nan) for name in ("x", "y", "yaw", "steering")}
    with pytest.raises(RecordingError, match="steering") as refused:
        guess_map([Table("log", {**log, **empty})])
    assert refused.value.found.endswith("without a number: 'x', 'y', 'yaw', 'steering'")


def test_columns_without_names_are_found_by_the_data(log):
    names = ("t", "speed", "yaw", "x", "yaw_rate", "y")
    columns = {str(i + 1): log[name] for i, name in enumerate(names)}
    columns |= {"steering": log["steering"], "throttle": log["throttle"]}
    m = guess_map([Table("log", columns)]).map
    assert (m.poses.x.column, m.poses.y.column, m.poses.yaw.column) == ("4", "6", "3")
    assert m.encoder.speed.column == "2"
    assert m.gyro.yaw_rate.column == "5"


def test_a_guess_turns_an_accelerometer_that_is_mounted_across(log):
    columns = {**log, "accel_x": log["accel_y"], "accel_y": -log["accel_x"]}
    guess = guess_map([Table("log", columns)])
    data = convert_tables([Table("log", columns)], guess.map)
    expected = np.stack([log["accel_x"], log["accel_y"]], axis=1)
    assert data.streams["accelerometer"].values == pytest.approx(expected)


def test_poses_in_millimetres_are_no_wrong_encoder(log):
    (first, *_) = [f for f in find({**log, "x": 1e3 * log["x"], "y": 1e3 * log["y"]}) if f.severe]
    assert 'x and y of [poses] need unit = "mm"' in first.remedy


def test_a_gap_is_no_contradiction(log):
    cut = {name: np.delete(values, slice(1500, 2500)) for name, values in log.items()}
    assert not [str(f) for f in find(cut) if f.remedy]


SPEED = without_sensors().replace('value = "throttle"', 'value = "throttle"\nkind = "speed"')


def test_a_commanded_speed_in_another_unit_states_its_scale(log):
    (found,) = [f for f in find(log, SPEED) if f.remedy]
    scale = re.search(r"multiply the scale of value of \[throttle\] by (\S+),", found.remedy)
    assert float(scale[1]) == pytest.approx(6.0, rel=0.01)
    scaled = {**log, "throttle": 6.0 * log["throttle"]}
    assert not [str(f) for f in find(scaled, SPEED) if f.remedy]


@pytest.mark.parametrize(("factor", "remedy"), [
    (3.6, 'value of [throttle] needs unit = "km/h"'), (1000.0, 'needs unit = "mm/s"'),
    (5.0, "multiply the scale of value of [throttle] by 0.2"), (2.0, None)])
def test_a_commanded_speed_that_no_car_follows_is_severe(log, factor, remedy):
    found = [f for f in find({**log, "throttle": 6.0 * factor * log["throttle"]}, SPEED)
             if f.severe]
    assert [remedy in f.remedy for f in found] == ([] if remedy is None else [True])


@pytest.mark.parametrize(("step", "stated"), [(1, False), (4, False), (10, True)])
def test_rare_rows_are_stated(log, step, stated):
    found = [str(f) for f in find({name: values[::step] for name, values in log.items()})]
    assert any("poses: 10 rows a second; record at 25 Hz" in line for line in found) == stated


def test_an_offset_that_is_no_error_has_its_direction_in_words(log):
    early = {**log, "yaw_rate": np.roll(log["yaw_rate"], -3)}
    assert any(re.search(r"\d+ ms earlier", str(f)) for f in find(early) if f.what == "gyro")


def test_a_limit_of_the_speed_is_found_and_applied():
    log = make_log(40.0, limit=1.2)
    log["throttle"] *= 6.0
    (found,) = [f for f in find(log, SPEED) if f.remedy]
    assert "needs limit = 1.20" in found.remedy
    limited = SPEED.replace('kind = "speed"', 'kind = "speed"\nlimit = 1.2')
    assert not [str(f) for f in find(log, limited) if f.remedy]
    data = convert_tables([Table("log", log)], parse_map(limited, "map"))
    assert data.streams["commands"].values[:, 1].max() == 1.2


def test_what_no_data_can_show_is_a_question(log):
    columns = {**log, "steering_angle": 0.4 * log["steering"]}
    del columns["steering"]
    questions = " ".join(guess_map([Table("log", columns)]).questions)
    assert "largest steering angle" in questions
    assert "kind speed" in questions


def test_a_guess_takes_no_unit_of_another_quantity(log):
    """speed_ms is in m/s, and the g of a global frame is no acceleration."""
    names = {"t": "t", "x_g": "x", "y_g": "y", "yaw": "yaw", "steering": "steering",
             "throttle": "throttle", "speed_ms": "speed"}
    guess = guess_map([Table("log", {name: log[key] for name, key in names.items()})]).map
    assert column_of(guess.poses.x) == Column(column="x_g")
    assert column_of(guess.encoder.speed) == Column(column="speed_ms", unit="m/s")
    with pytest.raises(ConfigError, match=r"encoder\.speed has an unknown unit"):
        parse_map(MAP.replace('speed = "speed"', 'speed = {column = "speed", unit = "ms"}'), "map")


@pytest.mark.parametrize(("factor", "rows", "remedy"), [
    (180.0 / np.pi, slice(None), "state the unit"), (1e6, slice(5, 6), "remove these rows")])
def test_values_beyond_any_car_are_refused_without_a_sensor_to_compare(log, factor, rows, remedy):
    columns = {name: log[name] for name in ("t", "steering", "throttle", "yaw_rate")}
    text = "\n".join(part for part in re.split(r"\n(?=\[)", MAP)
                     if not re.match(r"\[(poses|encoder|accelerometer)", part))
    assert not any(f.severe for f in find(columns, text))
    columns["yaw_rate"] = log["yaw_rate"].copy()
    columns["yaw_rate"][rows] *= factor
    (found,) = (f for f in find(columns, text) if f.severe)
    assert "35 rad/s" in found.text
    assert remedy in found.remedy


@pytest.mark.parametrize("angle", [0.300033, 0.29997])
def test_the_full_scale_of_a_guess_is_not_below_the_largest_angle(log, angle):
    size = angle / np.max(np.abs(log["steering"]))
    columns = {**log, "steering_angle": size * log["steering"]}
    del columns["steering"]
    table = Table("log", columns)
    guess = guess_map([table]).map
    assert guess.steering.full_scale >= angle
    convert_tables([table], guess)


def test_a_log_of_one_row_a_second_is_checked_without_a_crash():
    slow = {name: values[::10] for name, values in make_log(1200.0, rate=10.0).items()}
    assert any("1 rows a second" in str(found) for found in find(slow))
