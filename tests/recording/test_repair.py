"""``data repair``: the index of a run that was not closed."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader

from dart_hal.cli.main import main
from dart_hal.core.errors import RecordingError
from dart_hal.recording.repair import repair
from dart_hal.recording.run import RunReader

OLD_RUN = Path(__file__).parent / "fixtures" / "v0_1" / "run.mcap.gz"


def everything(path):
    run = RunReader(path)
    return (run.metadata, list(run.replay()), list(run.sent()), list(run.commands()),
            list(run.i2c()))


def strictly_read(path) -> int:
    """Messages as mcap's own reader gives them, every checksum verified, by the index."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary().chunk_indexes
        return len(list(reader.iter_messages()))


def test_a_killed_run_becomes_the_file_that_closing_would_have_made(tmp_path, writing):
    killed = tmp_path / "killed.mcap"
    closed = tmp_path / "closed.mcap"
    writer = writing(closed, close=False)
    writer._file.flush()
    killed.write_bytes(closed.read_bytes())
    writer.close()
    with pytest.raises(McapError):  # no index, no end
        strictly_read(killed)
    done = repair(killed)
    assert (done.left_out, done.messages) == (0, strictly_read(killed))
    assert killed.read_bytes() == closed.read_bytes()


@pytest.mark.parametrize("size", [20, 500, 4000, 12_000, -1, -50])
def test_everything_that_was_whole_is_there(tmp_path, writing, size):
    path = tmp_path / "run.mcap"
    writing(path)
    data = path.read_bytes()[:size]
    path.write_bytes(data)
    before = everything(path)
    done = repair(path)
    run = RunReader(path)
    assert everything(path) == before
    assert (run.complete, run.damaged) == (True, False)
    assert done.old.read_bytes() == data
    assert [p.name for p in tmp_path.iterdir() if "part" in p.name] == []


def test_a_damage_is_left_out(tmp_path, writing):
    path = tmp_path / "run.mcap"
    writing(path, frames=60)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    before = everything(path)
    done = repair(path)
    assert done.left_out > 0
    assert everything(path) == before
    assert not RunReader(path).damaged
    assert strictly_read(path) == done.messages


@pytest.mark.parametrize("cut", [None, -9000, 200_000])
def test_a_run_of_version_0_1_gets_chunks(tmp_path, cut):
    path = tmp_path / "run.mcap"
    path.write_bytes(gzip.decompress(OLD_RUN.read_bytes())[:cut])
    before = everything(path)
    done = repair(path)
    if cut is None:
        assert done.old is None, "it is whole"
    else:
        assert everything(path) == before
        assert strictly_read(path) == done.messages > 300


def test_a_whole_run_is_left_alone(run_file):
    data = run_file.read_bytes()
    assert repair(run_file).old is None
    assert run_file.read_bytes() == data
    assert [p.name for p in run_file.parent.iterdir()] == [run_file.name]


def test_an_older_repair_is_not_overwritten(run_file):
    data = run_file.read_bytes()[:-5]
    run_file.write_bytes(data)
    other = run_file.with_name(run_file.name + ".old")
    other.write_bytes(b"mine")
    with pytest.raises(RecordingError, match="earlier repair"):
        repair(run_file)
    assert (run_file.read_bytes(), other.read_bytes()) == (data, b"mine")


def test_the_verb(run_file, tmp_path, capsys):
    def run(*args) -> str:
        with pytest.raises(SystemExit) as left:
            main(["data", "repair", *map(str, args)])
        assert left.value.code in (0, None)
        return capsys.readouterr().out

    assert "not changed" in run(run_file)
    run_file.write_bytes(run_file.read_bytes()[:-300])
    (entry,) = json.loads(run(run_file, "--json"))["files"]
    assert entry["repaired"]
    assert Path(entry["old"]).is_file()
    assert json.loads(run(run_file, "--json"))["files"][0]["repaired"] is False
