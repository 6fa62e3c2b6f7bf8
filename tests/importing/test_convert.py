"""Tables are converted to streams in SI units, and what does not fit is refused with a remedy."""

from __future__ import annotations

import re

import numpy as np
import pytest

from dart_hal.car.runs import read_run
from dart_hal.core.errors import ConfigError, RecordingError
from dart_hal.recording.imported import read_data, write_imported
from dart_lab.cli.data import import_command
from dart_lab.importing import convert_tables, list_shipped_maps, load_map, read_tables
from dart_lab.importing.maps import parse_map
from dart_lab.importing.tables import Table
from tests.importing.logs import MAP, make_log, write_csv

MAP_HELP = next(option.help for option in import_command.params if option.name == "map_name")


@pytest.fixture(scope="module")
def log():
    return make_log(12.0)


def convert(columns, text=MAP):
    return convert_tables([Table("log.csv", columns)], parse_map(text, "map"), text)


@pytest.mark.slow_except(" *")
@pytest.mark.parametrize(("delimiter", "header", "comment", "bom"), [
    (",", True, "", ""), (";", True, "", "\ufeff"), ("\t", True, "# made by a lab", ""),
    (" ", False, "# " + " ".join(make_log(0.5)), ""), ("|", True, "", "")])
def test_csv_files_of_any_form_give_the_same_columns(log, tmp_path, delimiter, header, comment,
                                                     bom):
    path = write_csv(tmp_path / "log.csv", log, delimiter, header, comment)
    path.write_text(bom + path.read_text())
    (table,) = read_tables([path])
    assert list(table.columns) == list(log)
    for name, values in log.items():
        assert table.columns[name] == pytest.approx(values, abs=1e-6)


def test_a_file_without_header_numbers_its_columns(log, tmp_path):
    (table,) = read_tables([write_csv(tmp_path / "log.csv", log, header=False)])
    assert list(table.columns) == [str(i + 1) for i in range(len(log))]


def test_decimal_commas_and_empty_cells_are_read(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t;v;note\n0,5;1,25;start\n0,6;;\n")
    (table,) = read_tables([path])
    assert table.columns["t"] == pytest.approx([0.5, 0.6])
    assert np.isnan(table.columns["v"][1])
    assert table.text_columns["note"] == (2, "start")


@pytest.mark.parametrize("separator", [";", " ", "\t"])
def test_decimal_commas_are_read_without_a_header(tmp_path, separator):
    """The comma divides every line as well, even into more cells."""
    path = tmp_path / "log.csv"
    path.write_text("".join(f"{separator.join(['0,5', f'{k},25', '7,0'])}\n" for k in range(3)))
    (table,) = read_tables([path])
    assert {name: list(column) for name, column in table.columns.items()} == {
        "1": [0.5, 0.5, 0.5], "2": [0.25, 1.25, 2.25], "3": [7.0, 7.0, 7.0]}


def test_a_degree_sign_of_windows_is_read(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("t,yaw [°]\n0.0,1.5\n0.1,1.6\n".encode("cp1252"))
    (table,) = read_tables([path])
    assert table.columns["yaw [°]"] == pytest.approx([1.5, 1.6])


def test_units_signs_scales_and_zeros_are_applied(log):
    text = """
        schema = "dart-hal/import/1"
        name = "units"
        time = {column = "t", unit = "ms"}
        [poses]
        x = {column = "x", unit = "mm"}
        y = {column = "y", sign = -1}
        yaw = {column = "yaw", unit = "deg", zero = 90.0}
        [steering]
        value = {column = "steering", unit = "us", zero = 1500.0, sign = -1}
        kind = "pulse"
        full_scale = 400e-6
        [throttle]
        value = {column = "throttle", unit = "%"}
        [encoder]
        speed = {column = "speed", unit = "rpm", scale = 0.05}
    """
    columns = {"t": 1e3 * log["t"], "x": 1e3 * log["x"], "y": -log["y"],
               "yaw": np.rad2deg(log["yaw"]) + 90.0, "steering": 1500.0 - 400.0 * log["steering"],
               "throttle": 100.0 * log["throttle"],
               "speed": log["speed"] / 0.05 * 60.0 / (2.0 * np.pi)}
    data = convert(columns, text)
    expected = convert(log)
    for name in ("poses", "commands", "encoder"):
        assert data.streams[name].t == pytest.approx(expected.streams[name].t)
        assert data.streams[name].values == pytest.approx(expected.streams[name].values, abs=1e-9)


def test_a_closed_gate_stops_the_throttle(log):
    gate = (log["t"] > 105.0).astype(float)
    data = convert({**log, "safe": gate}, MAP.replace(
        'value = "throttle"', 'value = "throttle"\ngate = "safe"'))
    commands = data.streams["commands"]
    assert not commands.values[commands.t <= 105.0, 1].any()
    assert commands.values[commands.t > 105.0, 1].all()


def test_repeated_messages_are_dropped_by_their_counter(log):
    held = np.arange(len(log["t"])) // 10
    first = held * 10
    columns = {**log, "number": held.astype(float) + 1.0, "speed": log["speed"][first]}
    data = convert(columns, MAP.replace('speed = "speed"', 'speed = "speed"\nchanges = "number"'))
    assert len(data.streams["encoder"].t) == len(np.unique(held))
    assert "repeat 'number'" in data.facts["changes"][0]


def test_commands_of_two_topics_are_merged(log):
    fast = Table("/servo", {"t": log["t"], "steering": log["steering"]})
    slow = Table("/motor", {"t": log["t"][3::5] + 0.004, "throttle": log["throttle"][3::5]})
    rest = Table("/rest", log)
    text = MAP.replace('time = "t"', 'time = "t"\ntable = "/rest"').replace(
        'value = "steering"', 'value = "steering"\ntable = "/servo"').replace(
        'value = "throttle"', 'value = "throttle"\ntable = "/mot*"')
    commands = convert_tables([fast, slow, rest], parse_map(text, "map")).streams["commands"]
    at = 106.0021
    row = np.searchsorted(commands.t, at, side="right") - 1
    assert commands.values[row] == pytest.approx([
        log["steering"][np.searchsorted(log["t"], at) - 1],
        slow.columns["throttle"][np.searchsorted(slow.columns["t"], at) - 1]])


@pytest.mark.parametrize(("change", "what", "remedy"), [
    (lambda c: {**c, "steering": 30.0 * c["steering"]}, "steering commands leave", "full_scale"),
    (lambda c: {**c, "t": c["t"] - 50.0 * (c["t"] > 106.0)}, "steps back", "split the file"),
    (lambda c: {k: v for k, v in c.items() if k != "yaw"}, "no column 'yaw'", "--guess"),
    (lambda c: {**c, "x": np.where(np.arange(len(c["x"])) % 5, c["x"], np.nan)},
     "empty or non-finite", "changes"),
    (lambda c: {k: v[:10] for k, v in c.items()}, "too few rows", "time"),
    (lambda c: {k: v[:60] for k, v in c.items()}, "too short", "longer log"),
    (lambda c: {**c, "t": 1e3 * c["t"]}, "10 s apart", 'unit = "ms"'),
    (lambda c: {**c, "t": 1e9 * c["t"]}, r"1e\+07 s apart", 'unit = "ns"'),
    (lambda c: {**c, "t": np.zeros(len(c["t"]))}, "too few rows", "time")])
def test_what_does_not_fit_is_refused_with_a_remedy(log, change, what, remedy):
    with pytest.raises(RecordingError, match=what) as error:
        convert(change(log))
    assert remedy in error.value.remedy


def test_empty_cells_name_their_column(log):
    with pytest.raises(RecordingError, match="empty or non-finite") as error:
        convert({**log, "yaw": np.full(len(log["t"]), np.nan)})
    assert f"{len(log['t'])} in 'yaw'" in error.value.found
    assert "'x'" not in error.value.found


def test_a_text_file_is_no_table(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("a note about a car and a track\n")
    with pytest.raises(RecordingError, match="a header but no rows"):
        read_tables([path])


def test_text_in_a_number_names_line_and_column(log, tmp_path):
    path = write_csv(tmp_path / "log.csv", log)
    lines = path.read_text().splitlines()
    lines[7] = lines[7].replace(lines[7].split(",")[1], "n/a", 1)
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="line 8, column 'x' is not a number"):
        convert_tables(read_tables([path]), parse_map(MAP, "map"))


def test_two_clocks_are_refused_and_a_delay_joins_them(log):
    tables = [Table("a", log), Table("b", {"t": log["t"] + 1e9, "speed": log["speed"]})]
    text = MAP.replace('time = "t"', 'time = "t"\ntable = "a"').replace(
        'speed = "speed"', 'speed = "speed"\ntable = "b"')
    with pytest.raises(RecordingError, match="two clocks") as error:
        convert_tables(tables, parse_map(text, "map"))
    assert "delay" in error.value.remedy
    joined = parse_map(text.replace('table = "b"', 'table = "b"\ndelay = 1e9'), "map")
    assert convert_tables(tables, joined).streams["encoder"].t == pytest.approx(log["t"])


@pytest.mark.parametrize(("text", "what"), [
    (MAP.replace('yaw = "yaw"', 'jaw = "yaw"'), "jaw"),
    (MAP.replace('x = "x"\n', 'x = {column = "x", unit = "furlong"}\n'), "unknown unit"),
    (MAP.replace('value = "steering"', 'value = "steering"\nkind = "angle"'), "full_scale"),
    (MAP.replace('[throttle]\nvalue = "throttle"\n', ""), "throttle"),
    (MAP.replace('value = "throttle"', 'value = "throttle"\nlimit = 1.0'), "throttle.limit"),
    (MAP.replace("import/1", "import/9"), "schema")])
def test_a_wrong_map_is_refused_with_its_key(text, what):
    with pytest.raises(ConfigError, match=what):
        parse_map(text, "map.toml")


def test_every_shipped_map_can_be_read():
    for name in list_shipped_maps():
        mapping, text = load_map(name)
        assert mapping.name
        assert "schema" in text
        assert re.search(rf"\b{name}\b", MAP_HELP), "the option --map lists it"
    with pytest.raises(ConfigError, match="no such map") as error:
        load_map("vesc")
    assert "f1tenth" in error.value.expected


@pytest.mark.slow
def test_a_recording_has_what_was_imported(log, tmp_path):
    data = convert(log)
    path = tmp_path / "run.mcap"
    write_imported(data, path)
    assert not list(tmp_path.glob("*.part"))
    again = read_data(path)
    for name, stream in data.streams.items():
        assert again.streams[name].t == pytest.approx(stream.t, abs=1e-9)
        assert np.array_equal(again.streams[name].values, stream.values)
    r = read_run(path)
    assert r.encoder == "ok"
    assert np.diff(r.messages.t) == pytest.approx(0.02)
    at = r.messages.t + log["t"][0]
    expected = np.interp(at, log["t"], log["yaw_rate"])
    assert r.messages.yaw_rate == pytest.approx(expected, abs=0.1)
    # The mean of the last 0.1 s is the speed of 0.05 s before.
    assert r.messages.speed == pytest.approx(
        np.interp(at - 0.05, log["t"], log["speed"]), abs=0.05)
    sampled, _ = r.commands.sample_means(len(r.mocap))
    assert sampled[100:200] == pytest.approx(log["throttle"][100:200], abs=1e-6)


def test_without_poses_the_messages_are_means(log, tmp_path):
    text = MAP.replace('[poses]\nx = "x"\ny = "y"\nyaw = "yaw"\n', "")
    path = tmp_path / "run.mcap"
    write_imported(convert(log, text), path)
    r = read_run(path)
    assert r.mocap is None
    assert r.span == pytest.approx(0.1)
    at = r.messages.t + log["t"][0]
    rows = np.searchsorted(log["t"], at[20])
    assert r.messages.yaw_rate[20] == pytest.approx(log["yaw_rate"][rows - 10:rows].mean(),
                                                    abs=0.05)


BATTERY_MAP = MAP + '[battery]\nvoltage = "volts"\n'


@pytest.mark.slow_except("<lambda>-mV")
@pytest.mark.parametrize(("rows", "unit"), [
    (lambda n: np.ones(n, dtype=bool), "V"), (lambda n: np.arange(n) % 100 == 7, "mV")])
def test_a_voltage_is_carried_also_if_few_rows_have_it(log, tmp_path, rows, unit):
    factor = {"V": 1.0, "mV": 1000.0}[unit]
    volts = factor * (8.0 - 0.1 * (log["t"] - log["t"][0]))
    volts[~rows(len(volts))] = np.nan
    text = BATTERY_MAP.replace('"volts"', f'{{column = "volts", unit = "{unit}"}}')
    write_imported(convert({**log, "volts": volts}, text), tmp_path / "run.mcap")
    battery = read_run(tmp_path / "run.mcap").battery
    assert battery.interpolate(np.array([3.0, 9.0])) == pytest.approx([7.7, 7.1], abs=1e-3)


def test_a_voltage_with_a_gap_is_not_used_and_that_is_noted(log, tmp_path):
    volts = np.where(np.abs(log["t"] - log["t"].mean()) < 1.5, np.nan, 8.0)
    write_imported(convert({**log, "volts": volts}, BATTERY_MAP), tmp_path / "run.mcap")
    r = read_run(tmp_path / "run.mcap")
    assert r.battery is None
    assert any("voltage of the battery is not used" in str(note) for note in r.notes)


@pytest.mark.parametrize(("volts", "remedy"), [
    (7900.0, 'unit = "mV"'), (1.4, "its scale"), (87.0, "name another column"), (0.0, "scale")])
def test_a_voltage_that_no_battery_has_is_refused(log, volts, remedy):
    with pytest.raises(RecordingError, match="no voltage of a small car") as error:
        convert({**log, "volts": np.full(len(log["t"]), volts)}, BATTERY_MAP)
    assert remedy in error.value.remedy


def test_a_voltage_alone_is_no_measurement(log):
    text = BATTERY_MAP[:BATTERY_MAP.index("[poses]")] + "[steering]" + BATTERY_MAP.split(
        "[steering]")[1].split("[encoder]")[0] + '[battery]\nvoltage = "volts"\n'
    with pytest.raises(RecordingError, match="only commands"):
        convert({**log, "volts": np.full(len(log["t"]), 8.0)}, text)


def test_a_failed_write_leaves_nothing(log, tmp_path, monkeypatch):
    monkeypatch.setattr("dart_hal.recording.cdr.encode_numbers", lambda row: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_imported(convert(log), tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())


def test_another_mcap_file_is_no_imported_recording(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(RecordingError, match="no imported recording"):
        read_data(path)


@pytest.mark.parametrize("start", [0.0, -5.0])
def test_a_log_that_begins_at_0_may_have_a_delay(log, tmp_path, start):
    columns = {**log, "t": log["t"] - log["t"][0] + start}
    data = convert(columns, MAP.replace("[gyro]", "[gyro]\ndelay = 0.012"))
    write_imported(data, tmp_path / "run.mcap")
    again = read_data(tmp_path / "run.mcap")
    ages = [stream.t[0] for stream in again.streams.values()]
    assert max(ages) - min(ages) == pytest.approx(0.012, abs=1e-6)


def test_a_step_forward_of_the_clock_is_refused_by_its_row(log):
    columns = {**log, "t": np.concatenate([[0.0], 1.7e9 + log["t"][1:]])}
    with pytest.raises(RecordingError, match=r"steps forward by 1\.7e") as caught:
        convert(columns)
    assert "row 2" in caught.value.found


def test_rows_that_were_sorted_are_stated(log):
    columns = {name: values.copy() for name, values in log.items()}
    for values in columns.values():
        values[[10, 11]] = values[[11, 10]]
    data = convert(columns)
    assert any("1 rows up to 0.01 s out of order" in text for text in data.facts["changes"])
