"""`dart-hal data import`: from the log of another lab to a file that every verb reads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dart_hal.recording.imported import is_imported
from tests.importing.logs import MAP, make_log, write_csv


@pytest.fixture
def log(tmp_path):
    write_csv(tmp_path / "log.csv", make_log(30.0))
    (tmp_path / "map.toml").write_text(MAP)
    return tmp_path


@pytest.mark.slow
def test_a_log_is_imported_and_checked(verb, log):
    ran = verb("data", "import", log / "log.csv", "--map", log / "map.toml",
               "--out", log / "run.mcap")
    assert ran.code == 0
    assert "gyro: yaw_rate is 1.0" in ran.out
    assert "no car is named" in ran.out
    assert is_imported(log / "run.mcap")
    facts = json.loads(verb("data", "check", log / "run.mcap", "--json").out)["files"][0]
    assert facts["schema"] == "run"
    again = verb("data", "import", log / "log.csv", "--map", log / "map.toml",
                 "--out", log / "run.mcap")
    assert "is replaced: it was an import" in again.err
    assert not (log / "run.1.mcap").exists()


@pytest.mark.slow
def test_a_recording_that_is_no_import_is_kept(verb, log):
    for number, content in enumerate((b"a drive", b"another"), 1):
        (log / "run.mcap").write_bytes(content)
        ran = verb("data", "import", log / "log.csv", "--map", log / "map.toml",
                   "--out", log / "run.mcap")
        assert f"run.{number}.mcap is the recording that was there" in ran.err
        assert (log / f"run.{number}.mcap").read_bytes() == content
    assert is_imported(log / "run.mcap")


@pytest.mark.slow
def test_a_contradiction_is_refused_and_nothing_is_written(verb, log):
    wrong = MAP.replace('value = "steering"', 'value = {column = "steering", sign = -1}')
    (log / "map.toml").write_text(wrong)
    command = ("data", "import", log / "log.csv", "--map", log / "map.toml",
               "--out", log / "run.mcap")
    ran = verb(*command)
    assert ran.code == 2
    assert "[steering] needs sign = -1" in ran.err
    assert sorted(p.name for p in log.iterdir()) == ["log.csv", "map.toml"]
    assert verb(*command, "--unchecked").code == 0
    refused = verb("identify", "all", log / "run.mcap", "--dry-run")
    assert refused.code == 2
    assert "turns to the other side" in refused.err


def test_a_damaged_log_leaves_nothing_behind(verb, log):
    text = (log / "log.csv").read_text().splitlines()
    text[9] = text[9].replace(text[9].split(",")[3], "n/a", 1)
    (log / "log.csv").write_text("\n".join(text))
    for words in (("--out", log / "run.mcap"), ("--out", log / "run.mcap", "--unchecked")):
        ran = verb("data", "import", log / "log.csv", "--map", log / "map.toml", *words)
        assert ran.code == 2
        assert "line 10, column 'yaw' is not a number" in ran.err
        assert sorted(p.name for p in log.iterdir()) == ["log.csv", "map.toml"]


@pytest.mark.slow
def test_a_last_line_that_is_cut_off_is_stated(verb, log):
    text = (log / "log.csv").read_text()
    (log / "log.csv").write_text(text[:-40])
    ran = verb("data", "import", log / "log.csv", "--map", log / "map.toml",
               "--out", log / "run.mcap")
    assert ran.code == 0
    assert f"dropped: log.csv: the last line, {len(text.splitlines())}, which is cut off" in ran.out


@pytest.mark.slow
def test_a_proposed_map_imports_the_log(verb, log):
    ran = verb("data", "import", log / "log.csv", "--guess", "--out", log / "guess.toml")
    assert ran.code == 0
    assert "kind speed" in ran.err
    assert verb("data", "import", log / "log.csv", "--map", log / "guess.toml",
                "--out", log / "run.mcap").code == 0
    shown = verb("data", "import", log / "log.csv", "--guess", "--json")
    assert json.loads(shown.out)["map"] == (log / "guess.toml").read_text()


@pytest.mark.slow
def test_the_sizes_of_the_named_car_are_in_the_recording(verb, log):
    from dart_hal.car.runs import read_run

    folder = Path(__file__).parents[2] / "cars"
    assert verb("data", "import", log / "log.csv", "--map", log / "map.toml", "--car", "dart-01",
                "--cars", folder, "--out", log / "run.mcap", "--json").code == 0
    assert read_run(log / "run.mcap").car.name == "dart-01"


@pytest.mark.parametrize(("words", "what"), [
    ((), "no file to import"), (("log.csv",), "no map"), (("log.csv", "--map", "vesc"), "no such"),
    (("gone.csv", "--map", "mocap"), "no such file"), (("gone.csv",), "no such file"),
    (("log.csv", "--map", "mushr"), "fits no table"),
    (("log.csv", "--map", "deep-dynamics"), "no column 'time"),
    (("log.csv", "--guess", "--out", "map.mcap"), "is no map"),
    (("log.csv", "--map", "map.toml", "--out", "run.toml"), "is no recording")])
def test_wrong_words_are_refused(verb, log, monkeypatch, words, what):
    monkeypatch.chdir(log)
    ran = verb("data", "import", *words)
    assert ran.code == 2
    assert what in ran.err
    assert sorted(p.name for p in log.iterdir()) == ["log.csv", "map.toml"]


@pytest.mark.slow
def test_an_imported_recording_cannot_be_replayed_and_is_refused(verb, log):
    verb("data", "import", log / "log.csv", "--map", log / "map.toml", "--out", log / "run.mcap")
    ran = verb("replay", log / "run.mcap")
    assert ran.code == 2
    assert "has no bytes of a Nano" in ran.err.replace("\n", " ")
