"""``dart-hal export``: what is written, what is reported, what is refused."""

from __future__ import annotations

import csv
import sys

import pytest

from tests.common import MOCK_7_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


@pytest.fixture
def run(verb, tmp_path):
    verb("record", "--url", MOCK_7_URL, "--duration", 0.3, "--out", tmp_path / "run.mcap")
    return tmp_path / "run.mcap"


@pytest.mark.slow
def test_csv_is_always_there(verb, run, tmp_path, monkeypatch):
    for name in ("pandas", "pyarrow"):
        monkeypatch.setitem(sys.modules, name, None)
    out = tmp_path / "tables" / "run.csv"
    result = verb("export", "csv", run, "--out", out, "--json").json
    assert set(result) == {"recording", "table", "rows", "columns"}
    assert result["columns"]["speed"] == "m/s"
    rows = list(csv.reader(out.read_text().splitlines()))
    assert rows[0] == list(result["columns"])
    assert len(rows) == result["rows"] + 1 > 25
    assert f"{result['rows']} rows" in verb("export", "csv", run, "--out", out).out


@pytest.mark.slow
def test_parquet(verb, run, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    result = verb("export", "parquet", run, "--out", tmp_path / "run.parquet", "--json").json
    assert pq.read_table(tmp_path / "run.parquet").num_rows == result["rows"]


def test_parquet_without_pyarrow_is_refused_and_nothing_is_written(verb, run, tmp_path,
                                                                   monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    error = verb("export", "parquet", run, "--out", tmp_path / "run.parquet", "--json").error
    assert "pyarrow" in error["what"]
    assert "pip install" in error["try"]
    assert not (tmp_path / "run.parquet").exists()


@pytest.mark.slow
def test_bags_are_new_files_of_the_right_name(verb, run, tmp_path):
    result = verb("export", "ros1", run, "--out", tmp_path / "run.bag", "--json").json
    assert set(result) == {"recording", "bag", "messages"}
    assert result["messages"] > 100
    before = (tmp_path / "run.bag").read_bytes()
    for out, why in (("run.bag", "exists already"), ("run", "must end in .bag")):
        assert why in verb("export", "ros1", run, "--out", tmp_path / out, "--json").error["what"]
    assert (tmp_path / "run.bag").read_bytes() == before
    (tmp_path / "two").mkdir()
    for kind in ("ros2", "lerobot", "csv"):
        error = verb("export", kind, run, "--out", tmp_path / "two", "--json").error
        assert "exists already" in error["what"]


@pytest.mark.slow
def test_a_bag_of_ros_2_and_a_data_set_of_two_runs(verb, tmp_path):
    script = tmp_path / "bend.py"
    script.write_text("def control(state):\n    return 0.1, 0.2\n")
    run = tmp_path / "drive.mcap"
    verb("drive", script, "--url", MOCK_7_URL, "--duration", 1, "--record", run)
    result = verb("export", "ros2", run, "--out", tmp_path / "bag", "--json").json
    assert result["messages"] > 300
    assert (tmp_path / "bag" / "metadata.yaml").is_file()
    result = verb("export", "lerobot", run, run, "--out", tmp_path / "set", "--fps", 25,
                  "--json").json
    assert (result["episodes"], result["held"]) == (2, 0)
    assert (tmp_path / "set" / "meta" / "info.json").is_file()
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_an_export_that_fails_leaves_nothing(verb, run, tmp_path):
    """No driving: found when the folder is being filled."""
    error = verb("export", "lerobot", run, "--out", tmp_path / "set", "--json").error
    assert "no commands" in error["what"]
    assert {p.name for p in tmp_path.iterdir()} == {"run.mcap"}


def test_several_runs_are_episodes_of_lerobot_alone(verb, run, tmp_path):
    error = verb("export", "ros2", run, run, "--out", tmp_path / "two", "--json").error
    assert error["what"] == "export ros2 takes one recording"


@pytest.mark.slow
def test_a_recording_is_not_written_over(verb, run):
    before = run.read_bytes()
    assert "replace" in verb("export", "csv", run, "--out", run, "--json").error["what"]
    assert run.read_bytes() == before


def test_what_is_no_run_or_no_kind_is_refused(verb, run, tmp_path):
    assert "none.mcap" in verb("export", "csv", tmp_path / "none.mcap", "--out", "x.csv",
                               "--json").error["what"]
    assert "xlsx" in verb("export", "xlsx", run, "--out", "x", "--json").error["what"]
    assert "--out" in verb("export", "csv", run, "--json").error["what"]
