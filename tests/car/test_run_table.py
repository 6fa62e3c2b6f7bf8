"""A run as a table: every State a row, commands and logs in the row they belong to."""

from __future__ import annotations

import csv
import sys

import numpy as np
import pytest

from dart_hal import Car, to_dataframe
from dart_hal.car.export import write_csv, write_parquet
from dart_hal.car.table import TABLE_COLUMNS, read_table
from dart_hal.core.errors import RecordingError, UsageError


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """0.5 s at 50 Hz: a command and a log in every second row, and States."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    states = []
    plan = np.arange(4.0)
    with Car.open("sim://?seed=3&nano=mock", record=path) as car:
        list(car.states(duration=1.0))
        car.on_state(states.append)
        for n, state in enumerate(car.states(duration=0.5, every=2)):
            car.drive(steering=0.001 * n)
            car.log("loop/n", n)
            car.log("loop/seq", state.seq)
            car.log("loop/plan", plan.reshape(2, 2) + n)
    return path, states


@pytest.mark.slow
def test_every_state_is_a_row_and_every_number_is_exact(run):
    path, states = run
    table = read_table(path)
    last = slice(len(table) - len(states), None)
    for name in ("t", "speed", "yaw_rate", "accel_x", "ticks", "steering_us"):
        expected = np.array([TABLE_COLUMNS[name].of(s) for s in states], dtype=float)  # None: NaN
        np.testing.assert_array_equal(table.columns[name][last], expected)
    assert np.isfinite(table.columns["yaw_rate"][-1])
    assert {len(column) for column in table.columns.values()} == {len(table)}
    assert table.columns["flags"][-1] == "|".join(sorted(states[-1].health.flags))


def test_what_was_logged_is_in_the_row_of_its_state_alone(run):
    columns = read_table(run[0]).columns
    there = np.isfinite(columns["log/loop/n"])
    assert columns["log/loop/n"][there].tolist() == list(range(25))
    assert columns["log/loop/seq"][there].tolist() == columns["seq"][there].tolist()
    assert columns["log/loop/plan[1,0]"][there].tolist() == [n + 2.0 for n in range(25)]
    assert columns["command_steering"][there] == pytest.approx([0.001 * n for n in range(25)])
    for name in ("log/loop/seq", "log/loop/plan[0,0]", "command_throttle"):
        assert (np.isfinite(columns[name]) == there).all()
    assert not there[:10].any(), "nothing is put where nothing was logged"


def test_poses_of_the_room_are_columns_where_there_is_a_source(run, tmp_path):
    path = tmp_path / "room.mcap"
    states = []
    with Car.open("sim://?seed=3&nano=mock&mocap=1", record=path) as car:
        car.on_state(states.append)
        list(car.states(duration=0.5))
    last = states[-1].external.estimate.pose
    columns = read_table(path).columns
    assert [columns[f"room_{key}"][-1] for key in ("x", "y", "yaw")] == [last.x, last.y, last.yaw]
    assert "room_x" not in read_table(run[0]).columns


def test_no_duration_has_no_state():
    with Car.open("sim://?seed=3&nano=mock") as car:
        assert list(car.states(duration=0.0)) == []
        assert len(list(car.states(duration=0.02))) == 2


def test_every_column_has_a_unit(run):
    table = read_table(run[0])
    assert list(table.units) == list(table.columns)
    assert {n: table.units[n] for n in ("t", "speed", "yaw_rate", "steering_us", "log/loop/n")} == {
        "t": "s", "speed": "m/s", "yaw_rate": "rad/s", "steering_us": "us", "log/loop/n": ""}
    assert all(column.meaning for column in TABLE_COLUMNS.values())


def test_a_csv_reads_back_exactly(run, tmp_path):
    table = read_table(run[0])
    write_csv(table, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(table.columns)
    for name in ("t", "speed", "x", "log/loop/plan[1,1]"):
        cells = [float(row[name]) if row[name] else np.nan for row in rows]
        np.testing.assert_array_equal(cells, table.columns[name])
    assert rows[0]["log/loop/n"] == ""


@pytest.mark.slow
def test_a_dataframe_has_the_table_and_its_units(run):
    pytest.importorskip("pandas")
    table = read_table(run[0])
    frame = to_dataframe(run[0])
    assert list(frame.columns) == list(table.columns)
    assert frame.attrs["units"] == table.units
    np.testing.assert_array_equal(frame["speed"], table.columns["speed"])
    assert frame["log/loop/n"].ffill().iloc[-1] == 24.0


@pytest.mark.slow
def test_parquet_holds_numbers_units_and_the_facts_of_the_run(run, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    table = read_table(run[0])
    write_parquet(table, tmp_path / "run.parquet")
    found = pq.read_table(tmp_path / "run.parquet")
    assert found.column_names == list(table.columns)
    assert found.schema.field("speed").metadata[b"unit"] == b"m/s"
    assert found.schema.metadata[b"run.car"] == b"sim-3"
    np.testing.assert_array_equal(found["log/loop/n"].to_numpy(), table.columns["log/loop/n"])


def test_without_pandas_it_names_what_to_install(run, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    table = read_table(run[0])
    for ask in (lambda: to_dataframe(run[0]), lambda: write_parquet(table, tmp_path / "x")):
        with pytest.raises(UsageError, match="needs") as error:
            ask()
        assert "pandas>=" in error.value.remedy
    assert not (tmp_path / "x").exists()


def test_a_file_that_is_no_run_is_refused_by_name(tmp_path):
    (tmp_path / "no.mcap").write_bytes(b"no run")
    with pytest.raises(RecordingError, match=r"no\.mcap"):
        read_table(tmp_path / "no.mcap")
