"""``dart-hal export``: what is written, what is said, what is refused."""

from __future__ import annotations

import csv
import sys

import pytest

MOCK = "sim://?seed=7&nano=mock"


@pytest.fixture
def run(verb, tmp_path):
    verb("record", "--url", MOCK, "--duration", 0.3, "--out", tmp_path / "run.mcap")
    return tmp_path / "run.mcap"


def test_csv_is_always_there(verb, run, tmp_path, monkeypatch):
    for name in ("pandas", "pyarrow"):
        monkeypatch.setitem(sys.modules, name, None)
    out = tmp_path / "tables" / "run.csv"
    told = verb("export", "csv", run, "--out", out, "--json").json
    assert set(told) == {"recording", "table", "rows", "columns"}
    assert told["columns"]["speed"] == "m/s"
    rows = list(csv.reader(out.read_text().splitlines()))
    assert rows[0] == list(told["columns"])
    assert len(rows) == told["rows"] + 1 > 25
    assert f"{told['rows']} rows" in verb("export", "csv", run, "--out", out).out


@pytest.mark.more
def test_parquet(verb, run, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    told = verb("export", "parquet", run, "--out", tmp_path / "run.parquet", "--json").json
    assert pq.read_table(tmp_path / "run.parquet").num_rows == told["rows"]


def test_parquet_without_pyarrow_is_refused_and_nothing_is_written(verb, run, tmp_path,
                                                                   monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    error = verb("export", "parquet", run, "--out", tmp_path / "run.parquet", "--json").error
    assert "pyarrow" in error["what"]
    assert "pip install" in error["try"]
    assert not (tmp_path / "run.parquet").exists()


def test_a_recording_is_not_written_over(verb, run):
    before = run.read_bytes()
    assert "replace" in verb("export", "csv", run, "--out", run, "--json").error["what"]
    assert run.read_bytes() == before


def test_what_is_no_run_or_no_kind_is_refused(verb, run, tmp_path):
    assert "none.mcap" in verb("export", "csv", tmp_path / "none.mcap", "--out", "x.csv",
                               "--json").error["what"]
    assert "xlsx" in verb("export", "xlsx", run, "--out", "x", "--json").error["what"]
    assert "--out" in verb("export", "csv", run, "--json").error["what"]
