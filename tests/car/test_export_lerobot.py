"""A data set of LeRobot: held against the format, and (slow) opened by the library itself."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from dart_hal.car import Car
from dart_hal.car.export.lerobot import (
    ACTION_COLUMNS,
    OBSERVATION_COLUMNS,
    episode,
    statistics,
    write_lerobot,
)
from dart_hal.car.table import read_table
from dart_hal.core.errors import UsageError

COUNTERS = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64",
            "index": "int64", "task_index": "int64"}
"""DEFAULT_FEATURES of lerobot/datasets/utils.py."""
EPISODE = {"episode_index", "tasks", "length", "data/chunk_index", "data/file_index",
           "dataset_from_index", "dataset_to_index", "meta/episodes/chunk_index",
           "meta/episodes/file_index"}


def record_drive(path, seconds, seed, options=""):
    with Car.open(f"sim://?seed={seed}&nano=mock{options}", record=path) as car:
        list(car.states(duration=0.3))
        for n, _ in enumerate(car.states(duration=seconds)):
            car.drive(steering=0.001 * n)
    return read_table(path)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return [record_drive(folder / "a.mcap", 0.6, 1), record_drive(folder / "b.mcap", 0.4, 2)]


@pytest.fixture(scope="module")
def data_set(tables, tmp_path_factory):
    path = tmp_path_factory.mktemp("set") / "laps"
    return path, write_lerobot(tables, path, fps=50, task="drive a bend")


@pytest.mark.slow
def test_it_has_what_the_format_requires(data_set):
    path, made = data_set
    info = json.loads((path / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (2, made.frames, 50)
    assert info["splits"] == {"train": "0:2"}
    first = {"chunk_index": 0, "file_index": 0}
    data = pq.read_table(path / info["data_path"].format(**first))
    assert set(data.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        kind = data.schema.field(name).type
        if feature["shape"] == [1]:
            assert (str(kind).replace("float", "float32"), feature["names"]) == (
                COUNTERS[name], None)
        else:
            assert kind.list_size == feature["shape"][0] == len(feature["names"])
            assert (feature["dtype"], str(kind.value_type)) == ("float32", "float")
    tasks = pd.read_parquet(path / "meta" / "tasks.parquet")
    assert (list(tasks.index), list(tasks["task_index"])) == (["drive a bend"], [0])
    rows = pq.read_table(path / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert all(set(row) >= EPISODE for row in rows)
    assert [row["dataset_to_index"] - row["dataset_from_index"] for row in rows] == [
        row["length"] for row in rows]
    assert rows[1]["dataset_from_index"] == rows[0]["dataset_to_index"]
    stats = json.loads((path / "meta" / "stats.json").read_text())
    for name, feature in info["features"].items():
        assert set(stats[name]) == {"min", "max", "mean", "std", "count",
                                    "q01", "q10", "q50", "q90", "q99"}
        assert len(stats[name]["mean"]) == feature["shape"][0]
        assert len(rows[0][f"stats/{name}/mean"]) == feature["shape"][0]


@pytest.mark.slow
def test_frames_come_at_the_stated_rate(data_set):
    path, made = data_set
    data = pq.read_table(path / "data" / "chunk-000" / "file-000.parquet").to_pandas()
    assert list(data["index"]) == list(range(made.frames))
    for _, frames in data.groupby("episode_index"):
        assert list(frames["frame_index"]) == list(range(len(frames)))
        np.testing.assert_allclose(frames["timestamp"], frames["frame_index"] / 50, atol=1e-4)
    assert [len(f) for _, f in data.groupby("episode_index")] == [30, 20]


def test_a_frame_is_the_newest_state_and_the_newest_command_until_then(tables):
    table = tables[0]
    columns, held = episode(table, 50)
    assert held == 0
    t = table.columns["t"]
    t0 = table.columns["t"][np.isfinite(table.columns[ACTION_COLUMNS[0]])][0]
    for k in (0, 7, len(columns["action"]) - 1):
        row = np.flatnonzero(t <= t0 + k / 50 + 1e-9)[-1]
        expected = [table.columns[name][row] for name in OBSERVATION_COLUMNS]
        assert columns["observation.state"][k].tolist() == (
            np.nan_to_num(np.float32(expected)).tolist())
        commands = table.columns[ACTION_COLUMNS[0]][:row + 1]
        assert columns["action"][k, 0] == np.float32(commands[np.isfinite(commands)][-1])


def test_no_number_is_missing(tables):
    columns = dict(tables[0].columns)
    columns["yaw_rate"] = columns["yaw_rate"].copy()
    columns["yaw_rate"][:60] = columns["yaw_rate"][70:80] = np.nan
    columns["yaw_rate"][69] = 0.25
    table = type(tables[0])(tables[0].run, tables[0].hello, 0, columns)
    yaw_rate = episode(table, 100)[0]["observation.state"][:, OBSERVATION_COLUMNS.index("yaw_rate")]
    assert np.isfinite(yaw_rate).all()
    assert np.count_nonzero(yaw_rate == np.float32(0.25)) >= 8


def test_frames_of_an_interrupted_link_are_counted(tables):
    keep = np.ones(len(tables[0]), bool)
    keep[50:80] = False  # 0.3 s
    columns = {name: column[keep] for name, column in tables[0].columns.items()}
    table = type(tables[0])(tables[0].run, tables[0].hello, 0, columns)
    assert 8 <= episode(table, 50)[1] <= 11, "0.2 s are older than 0.1 s"


def test_statistics_are_of_each_column():
    got = statistics(np.array([[0.0, 1.0], [2.0, 1.0]]))
    assert (got["mean"], got["std"], got["count"]) == ([1.0, 1.0], [1.0, 0.0], [2])
    assert statistics(np.arange(101))["q90"] == [90.0]


def test_a_run_without_driving_is_refused(tmp_path):
    with Car.open("sim://?seed=1&nano=mock", record=tmp_path / "still.mcap") as car:
        list(car.states(duration=0.1))
    with pytest.raises(UsageError, match="no commands"):
        write_lerobot([read_table(tmp_path / "still.mcap")], tmp_path / "set")


LOAD = """
import sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("dart/laps", root=sys.argv[1], delta_timestamps={
    "observation.state": [-0.04, -0.02, 0.0], "action": [0.0, 0.02]})
item = data[31]
print(data.num_episodes, data.num_frames, item["observation.state"].shape, item["action"].shape,
      item["task"], data.meta.stats["action"]["mean"].shape)
"""


@pytest.mark.long
def test_the_library_itself_opens_it(data_set):
    """Needs lerobot and torch, some 2 GB: pip install lerobot."""
    pytest.importorskip("lerobot")
    path, made = data_set
    done = subprocess.run([sys.executable, "-c", LOAD, str(path)], capture_output=True, text=True,
                          check=True).stdout.split("\n")[-2]
    assert done == (f"2 {made.frames} torch.Size([3, 9]) torch.Size([2, 2]) drive a bend (2,)")


@pytest.mark.slow
def test_the_voltage_is_a_feature_where_every_run_has_it(tables, tmp_path):
    measured = record_drive(tmp_path / "c.mcap", 0.6, 3, "&battery=1")
    write_lerobot([measured], tmp_path / "one")
    features = json.loads((tmp_path / "one" / "meta" / "info.json").read_text())["features"]
    assert features["observation.battery"] == {"dtype": "float32", "shape": [1], "names": None}
    voltage = pq.read_table(tmp_path / "one" / "data" / "chunk-000" / "file-000.parquet")[
        "observation.battery"].to_numpy()
    assert voltage == pytest.approx(8.2, abs=0.4)
    write_lerobot([measured, tables[0]], tmp_path / "two")
    assert "observation.battery" not in json.loads(
        (tmp_path / "two" / "meta" / "info.json").read_text())["features"]
    assert "battery" in measured.columns
    assert "battery" not in tables[0].columns
