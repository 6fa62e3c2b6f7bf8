"""Odd files of every kind: each is read, or refused by an error of this library that names it.

Infinite, huge and tiny numbers, other types, thousands of brackets, one channel for two things,
names that are markup, numbers of thousands of digits, cells of megabytes.
"""

from __future__ import annotations

import math
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.control.path_file import read_path
from dart_hal.core.config import parse_calibration, parse_config, parse_model
from dart_hal.core.errors import ConfigError, DartHalError, RecordingError, UsageError
from dart_hal.core.types import ExternalPose
from dart_hal.devices.poses import line
from dart_hal.devices.poses.file import open_file
from dart_hal.devices.poses.reading import Convention
from dart_hal.estimation.localisation.grid import read_grid
from dart_hal.recording.mcap_records import MCAP_MAGIC, parse_mcap, record_bytes
from dart_hal.vehicle.load import find_model
from tests.common import ROOT

CAR_TOML = (ROOT / "cars" / "dart-01" / "car.toml").read_text(encoding="utf-8")
V0_1 = ROOT / "tests" / "fixtures_v0_1"
CALIBRATION = (V0_1 / "calibration.toml").read_text(encoding="utf-8")
MODEL = (V0_1 / "model.toml").read_text(encoding="utf-8")
ODD = ("inf", "-inf", "nan", "1e300", "-1e300", "1e-300", "5e-324", "1e999", "0", "-1", "true",
       '""', '"x"', '"[bold red]"', '"<img src=x>"', '"a/b"', r'"\u0000"', "[]", "[[]]", "{}",
       "{ a = 1 }", "[inf]", "[1, 2, 3]", "[{}]", "{ value = 1, std = 1 }",
       "{ value = 1e300, std = 1 }", "{ value = 1, std = 1e300 }", "{ value = inf, std = nan }",
       "1979-05-27", "9" * 400, "9" * 5000, "18446744073709551616", "-9223372036854775809",
       "[" * 15 + "]" * 15, "[" * 5000 + "]" * 5000, '"' + "x" * 100_000 + '"')
ENTRY = re.compile(r"^(\s*[\w.]+)\s*=.*$", re.MULTILINE)


def read_model(text, origin):
    """A model file as the verbs read it: the parameters are used as well."""
    from dart_hal.vehicle.file import vehicle_from
    from dart_hal.vehicle.sets import PAPER

    return vehicle_from(parse_model(text, origin), PAPER)


READERS = {"car": (parse_config, CAR_TOML), "calibration": (parse_calibration, CALIBRATION),
           "model": (read_model, MODEL)}


def read_or_refuse(read, text, name="file.toml"):
    """True if it is read; a refusal names the file and is short enough to be read."""
    refusal = None
    try:
        read(text, name)
    except ConfigError as refused:
        refusal = refused
    assert refusal is None or (refusal.remedy and len(str(refusal)) < 3000)
    return refusal is None


@pytest.mark.parametrize("kind", list(READERS))
def test_the_texts_of_these_tests_are_read(kind):
    assert read_or_refuse(*READERS[kind])


def refusals(kind, values):
    """How many of the values, each at each entry of a file, are refused."""
    read, text = READERS[kind]
    return sum(not read_or_refuse(read, f"{text[:e.start()]}{e[1]} = {odd}{text[e.end():]}")
               for e in ENTRY.finditer(text) for odd in values)


@pytest.mark.parametrize("kind", list(READERS))
@pytest.mark.slow
def test_each_entry_of_a_file_with_some_odd_values(kind):
    assert refusals(kind, ("1e300", '"[bold red]"', "[[]]")) > 50


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(READERS))
def test_each_entry_of_a_file_with_each_odd_value(kind):
    assert refusals(kind, ODD) > 500


@pytest.mark.parametrize("text", [
    "a = " + "[" * 5000 + "]" * 5000, "a = " + "{ a = " * 900 + "1" + " }" * 900,
    "a." * 5000 + "b = 1", "[" * 3000, "a = " + "[" * 300 + "]" * 300, "\0", "", "name = 1",
    "a = 1e999999999", "provenance = { a = " + "[" * 400 + "]" * 400 + " }",
    "a = " + "9" * 100_000, 'a = """' + "x" * 1_000_000, "a = 1\n" * 3, "[[a]]\n" * 1000,
    "=", "[a", '"\\uD800" = 1', "a = 0x" + "f" * 10_000, "\ufffe", "a = 1979-99-99",
], ids=range(20))
@pytest.mark.parametrize("kind", list(READERS))
@pytest.mark.slow_except("car-[013-9]", "car-1[02-9]", "calibration-1", "model-1")
def test_texts_that_no_parser_can_hold(kind, text):
    assert not read_or_refuse(READERS[kind][0], text)


toml_values = st.recursive(
    st.floats() | st.integers() | st.booleans() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner,
                                                                max_size=3), max_leaves=6)


def toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{toml(k)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + "".join(f"\\U{ord(c):08X}" for c in value if not 0xD800 <= ord(c) < 0xE000) \
            + '"'
    return repr(value)


@given(st.sampled_from(sorted(READERS)), st.data(), toml_values)
def test_any_value_at_any_place_is_read_or_refused(kind, data, value):
    read, text = READERS[kind]
    entry = data.draw(st.sampled_from(list(ENTRY.finditer(text))))
    read_or_refuse(read, f"{text[:entry.start()]}{entry[1]} = {toml(value)}{text[entry.end():]}")


# -- car.toml by its meaning ------------------------------------------------------------------


def with_key(table, key, value):
    """The car's file with one key of a table changed or added."""
    document = tomlkit.parse(CAR_TOML)
    document[table][key] = value
    return tomlkit.dumps(document)


@pytest.mark.parametrize(("table", "key", "value", "named"), [
    ("pwm", "clock_channel", 1, "clock_channel"), ("pwm", "clock_channel", 0, "clock_channel"),
    ("pwm", "clock_channel", 16, "clock_channel"), ("pwm", "clock_channel", -1, "clock_channel"),
    ("throttle", "channel", 15, "clock_channel"), ("steering", "channel", 15, "clock_channel"),
    ("throttle", "channel", 0, "channel"), ("pwm", "bus", -1, "pwm.bus"),
    ("geometry", "mass", 1e300, "mass"), ("geometry", "wheel_radius", 0, "wheel_radius"),
    ("geometry", "yaw_inertia", -1, "yaw_inertia"), ("imu", "mount_yaw", 90, "degrees"),
    ("limits", "max_speed", 1e300, "max_speed"), ("limits", "max_speed", 0, "max_speed"),
    ("throttle", "stop_ramp", 1e11, "stop_ramp"),
    ("limits", "encoder_lost_throttle", -3, "encoder_lost_throttle"),
])
def test_what_no_car_can_be_is_refused_by_its_key(table, key, value, named):
    text = with_key(table, key, value)
    if (table, key, value) == ("throttle", "channel", 15) or (table, value) == ("steering", 15):
        text = re.sub(r"(?m)^clock_channel .*$", "", text)  # the default counts
    with pytest.raises(ConfigError) as refused:
        parse_config(text, "cars/a/car.toml")
    assert named in str(refused.value)
    assert "cars/a/car.toml" in str(refused.value)


@pytest.mark.parametrize("name", ["[bold red]", "[/]", "<img src=x onerror=alert(1)>", "a/b", "..",
                                  "", " ", "a\\nb", "\\u0007", "$(reboot)", "`id`", "x" * 65,
                                  "a;b", "a|b", "{car}", "\\u202Eabc"])
def test_a_name_that_is_markup_or_no_folder_is_refused(name):
    text = re.sub(r'(?m)^name = .*$', lambda _: f'name = "{name}"', CAR_TOML)
    with pytest.raises(ConfigError, match="name"):
        parse_config(text, "car.toml")
    if "/" not in name:
        assert parse_config(text, "car.toml", recorded=True), "an old recording is still read"


@pytest.mark.parametrize("name", ["dart-01", "DART 1 (old)", "Tom's & Ann's", "rot", "Zürich_2",
                                  "車", "a.b+c@d#1"])
def test_names_of_cars_are_taken(name):
    text = re.sub(r'(?m)^name = .*$', lambda _: f'name = "{name}"', CAR_TOML)
    assert parse_config(text, "car.toml").name == name


def test_a_model_of_a_file_is_refused_by_its_path(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text("a = " + "[" * 5000)
    with pytest.raises(ConfigError, match=r"model\.toml"):
        find_model(file)


# -- paths --------------------------------------------------------------------------------------

SQUARE = ("0,0", "1,0", "1,1", "0,1", "0,0")
CELLS = ("inf", "-inf", "nan", "1e300", "-1e300", "1e-300", "1e999", "", "x", "[bold red]", "\0",
         "9" * 5000, "1e8", "1_0", "0x10", "x" * 200_000, '"', "1;2", "١", "1e5", "-0.0")


def read_path_or_refuse(file):
    refusal = ""
    try:
        assert math.isfinite(read_path(file).length)
    except UsageError as refused:
        refusal = str(refused)
    assert len(refusal) < 3000
    return not refusal


@pytest.mark.parametrize("header", ["x,y", "x,y,speed", "# x_m; y_m; vx_mps", "x_mm,y_mm"])
@pytest.mark.parametrize("cell", CELLS, ids=range(len(CELLS)))
@pytest.mark.slow_except("*-x,y,speed", "3-*")
def test_a_path_with_an_odd_cell(tmp_path, header, cell):
    delimiter = ";" if ";" in header else ","
    end = f"{delimiter}1.0" if "speed" in header or "vx" in header else ""
    rows = [row.replace(",", delimiter) + end for row in SQUARE]
    for place in range(3):
        cells = rows[2].split(delimiter)
        if place < len(cells):
            cells[place] = cell
        file = tmp_path / f"path{place}.csv"
        file.write_text("\n".join([header, *rows[:2], delimiter.join(cells), *rows[3:]]),
                        encoding="utf-8")
        read_path_or_refuse(file)


@pytest.mark.parametrize("rows", [
    ["0,0"], ["0,0", "0,0"], ["0,0", "1e-300,0", "2e-300,0"], ["0,0"] * 50,
    ["1e7,1e7", "1e7,1e7"], ["0,0", "1,0,"], [",,,"], ["0,0,1e-300", "1,0,1e300"],
    ["99999,0", "-99999,0"], ["1e6,0", "2e6,0", "3e6,0"]])
@pytest.mark.parametrize("header", ["x,y", "x_m,y_m,speed"])
def test_odd_paths(tmp_path, header, rows):
    file = tmp_path / "path.csv"
    file.write_text("\n".join([header, *rows]))
    read_path_or_refuse(file)


@given(st.lists(st.tuples(st.floats(), st.floats(), st.floats()), max_size=6))
def test_any_numbers_make_a_path_or_are_refused(tmp_path_factory, rows):
    file = tmp_path_factory.mktemp("paths") / "path.csv"
    file.write_text("x_m,y_m,speed\n" + "\n".join(",".join(map(repr, row)) for row in rows))
    read_path_or_refuse(file)


def test_a_path_of_1e300_is_refused_by_line(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("x,y\n0,0\n1e300,0\n1,1\n")
    with pytest.raises(UsageError, match=r"path\.csv, line 3"):
        read_path(file)


# -- maps ---------------------------------------------------------------------------------------

MAP_KEYS = {"image": "map.pgm", "resolution": "0.05", "origin": "[-1.0, -1.0, 0.0]", "negate": "0",
       "occupied_thresh": "0.65", "free_thresh": "0.196", "mode": "trinary"}
ODD_YAML = ("inf", ".inf", ".nan", "-.inf", "1e300", "-1", "0", "1e-300", "null", "[]", "{}",
            "[1, 2]", "[.inf, 0, 0]", "[1e300, 0, 0]", "[0, 0, .nan]", "'[bold red]'", "true",
            "9" * 400, "9" * 5000, "[" * 3000 + "]" * 3000, "2001-99-99", "!!python/object:os.x {}",
            "&a [*a]", "/dev/zero", ".", '"\\0"', "x" * 5000, "1:60:60", "!!binary '='")


def read_map_or_refuse(file):
    refusal = ""
    try:
        grid = read_grid(file)
        assert 0.0 < grid.cell <= 100.0
        assert np.abs(grid.origin).max() <= 1e5
    except UsageError as refused:
        refusal = str(refused)
    assert not refusal or ("map.yaml" in refusal and len(refusal) < 3000)
    return not refusal


@pytest.fixture
def image(tmp_path):
    (tmp_path / "map.pgm").write_bytes(b"P5\n4 3\n255\n" + bytes(12))
    return tmp_path / "map.yaml"


@pytest.mark.parametrize("odd", ODD_YAML, ids=range(len(ODD_YAML)))
def test_a_map_with_an_odd_entry(image, odd):
    for key in MAP_KEYS:
        image.write_text("\n".join(f"{k}: {odd if k == key else v}" for k, v in MAP_KEYS.items()))
        read_map_or_refuse(image)


@pytest.mark.parametrize(("key", "value"), [
    ("resolution", ".inf"), ("resolution", "1e300"), ("resolution", ".nan"),
    ("resolution", "1e-300"), ("origin", "[.nan, 0, 0]"), ("origin", "[1e300, 0, 0]"),
    ("origin", "[0, .inf, 0]"), ("origin", "[0, 0, .nan]"), ("free_thresh", ".nan"),
    ("occupied_thresh", "0.1"), ("negate", ".inf")])
def test_a_map_that_cannot_be_is_refused_by_name(image, key, value):
    image.write_text("\n".join(f"{k}: {value if k == key else v}" for k, v in MAP_KEYS.items()))
    assert not read_map_or_refuse(image)


def test_the_map_of_these_tests_is_read(image):
    image.write_text("\n".join(f"{k}: {v}" for k, v in MAP_KEYS.items()))
    assert read_map_or_refuse(image)


def test_a_map_of_aliases_that_expand_is_refused(image):
    """The YAML of a "billion laughs": ten names of ten names of ten."""
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    for key in MAP_KEYS:
        image.write_text("\n".join([*rows, *(f"{k}: {'*a8' if k == key else v}"
                                             for k, v in MAP_KEYS.items() if k != "image"),
                                    "image: map.pgm"]))
        assert read_map_or_refuse(image) is (key == "image")


@pytest.mark.parametrize("head", [
    b"P5\n99999999 99999999\n255\n", b"P5\n0 0\n255\n", b"P5\n4 3\n999\n", b"P5\n-1 3\n255\n",
    b"P5\n", b"", b"P6\n1 1\n255\n", b"P5\n" + b"9" * 5000 + b" 1\n255\n"])
def test_an_odd_image_of_a_map(image, head):
    image.write_text("\n".join(f"{k}: {v}" for k, v in MAP_KEYS.items()))
    (image.parent / "map.pgm").write_bytes(head)
    read_map_or_refuse(image)


def test_a_png_that_expands_too_far_is_refused_before_it_is_read(image):
    picture = pytest.importorskip("PIL.Image")
    import zlib

    def part(kind, data):
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))

    head = struct.pack(">IIBBBBB", 9000, 9000, 8, 0, 0, 0, 0)
    png = (b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head)
           + part(b"IDAT", zlib.compress(b"")) + part(b"IEND", b""))
    assert picture.MAX_IMAGE_PIXELS > 9000 * 9000, "control: Pillow itself takes it"
    (image.parent / "map.png").write_bytes(png)
    image.write_text("\n".join(f"{k}: {v}" for k, v in {**MAP_KEYS, "image": "map.png"}.items()))
    with pytest.raises(UsageError, match="9000 x 9000"):
        read_grid(image)


# -- poses --------------------------------------------------------------------------------------

NUMBERS = ("1e300", "-1e300", "1e-300", "1e999", "nan", "inf", "-inf", "1_0", "0x1", "x", "", "1e5",
           "9" * 250, "-1", "٣")


@pytest.mark.parametrize("number", NUMBERS)
def test_a_line_with_an_odd_number_is_a_pose_or_refused(number):
    for place in range(6):
        words = ["12.5", "1.5", "-0.2", "0.785", "0.01", "0.02"]
        words[place] = number
        data = f"dart-hal-pose 1 car room {' '.join(words)}\n".encode()
        try:
            poses = [Convention().read(r).to_external(0.0) for r in line.parse(data)]
        except ValueError:
            continue
        assert all(abs(pose.x) <= 1e5 and abs(pose.y) <= 1e5 and abs(pose.yaw) <= 4.0
                   and np.isfinite(pose.cov).all() for pose in poses)


@given(*[st.floats()] * 6, st.sampled_from(["m", "mm"]), st.booleans())
def test_any_pose_is_possible_or_refused(t, x, y, yaw, std, yaw_std, unit, left):
    from dart_hal.devices.poses.reading import PoseReading

    how = Convention(metres=1e-3 if unit == "mm" else 1.0, left=left)
    try:
        pose = how.read(PoseReading("car", "room", t, x, y, yaw, std, yaw_std)).to_external(1.0)
    except ValueError:
        return
    assert max(abs(pose.x), abs(pose.y)) <= 1e5
    assert np.isfinite(pose.cov).all()


@pytest.mark.parametrize("numbers", [(0.0, 0.0, 1e300, 0.0, 0.0), (0.0, 0.0, 0.0, 1e6, 0.0),
                                     (0.0, 0.0, 0.0, 0.0, 1e300), (1e300, 0.0, 0.0, 0.0, 0.0),
                                     (0.0, 0.0, math.inf, 0.0, 0.0)])
def test_a_pose_of_a_program_that_cannot_be_is_refused(numbers):
    with pytest.raises(ValueError, match=r"pose|stamp"):
        ExternalPose(*numbers)


@pytest.mark.parametrize("cell", [*NUMBERS, "x" * 200_000], ids=range(len(NUMBERS) + 1))
def test_a_file_of_poses_with_an_odd_cell(tmp_path, cell):
    file = tmp_path / "poses.csv"
    for place in range(6):
        cells = ["1.0", "1", "1", "1", "0.01", "0.02"]
        cells[place] = cell
        file.write_text("t,x,y,yaw,std,yaw_std\n0,0,0,0,0.01,0.02\n" + ",".join(cells) + "\n",
                        encoding="utf-8")
        try:
            source = open_file(file, Convention())
        except RecordingError as refused:
            refusal = str(refused)
        else:
            refusal = ""
        assert not refusal or "poses.csv" in refusal
        assert refusal or all(abs(pose.x) <= 1e5 for pose in [*source.poll(0.0), *source.poll(1e3)])


# -- recordings -----------------------------------------------------------------------------------


def test_facts_of_a_recording_that_no_parser_can_hold_are_left_out(tmp_path):
    from mcap.records import Attachment

    data = MCAP_MAGIC
    for text in ("[" * 100_000, "9" * 5000, '{"a": ' * 5000, '"x"', "[[1, 2]]"):
        data += record_bytes(Attachment(0, 0, "run", "application/json", text.encode()))
    found = parse_mcap(tmp_path, data)
    assert found.metadata in ({}, {"run": {1: 2}})


def test_a_recorded_car_that_cannot_be_is_refused_by_its_recording():
    from dart_hal.core.config.folders import parse_run_car

    with pytest.raises(DartHalError, match=r"run\.mcap"):
        parse_run_car("a = " + "[" * 5000, "car.toml in run.mcap", {})


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full"])
def test_a_device_is_no_path_and_no_map(device):
    with pytest.raises(OSError, match="device"):
        read_path(Path(device))
    with pytest.raises(UsageError):
        read_grid(Path(device))


def test_a_text_without_an_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("dart_hal.core.text_file.MAX_TEXT_BYTES", 1000)
    file = tmp_path / "path.csv"
    file.write_text("x,y\n" + "0,0\n" * 500)
    with pytest.raises(OSError, match="longer"):
        read_path(file)
