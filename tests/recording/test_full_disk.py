"""A disk that fills up: the recording ends and reports it, the drive goes on, the file can be
read."""

from __future__ import annotations

import os
import resource
from contextlib import contextmanager

import pytest
from click.testing import CliRunner

from dart_hal.car import Car
from dart_hal.cli.replay import command as replay_command
from dart_hal.core.errors import FileTrouble
from dart_hal.recording.repair import repair
from dart_hal.recording.run import RunReader, RunWriter
from tests.common import MOCK_1_URL


@contextmanager
def room_for(size):
    """No file of this process grows beyond ``size`` bytes: the kernel refuses the rest."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.slow
def test_the_drive_goes_on_and_the_file_ends_with_its_last_whole_chunk(tmp_path, caplog):
    path = tmp_path / "run.mcap"
    with Car.open(MOCK_1_URL, record=path) as car:
        car.arm()
        assert car.recorder.trouble is None
        room = path.stat().st_size + 60_001
        with room_for(room):
            states = []
            for state in car.states(duration=1.0):
                states.append(state)
                car.drive(steering=0.1, throttle=0.3)
                car.log("speed", state.speed)
                car.note("lap", {"n": str(len(states))})
        assert isinstance(car.recorder.trouble, FileTrouble)
        assert "large" in car.recorder.trouble.what  # "File too large": the kernel's message
    assert len(states) > 95
    assert states[-1].speed > 0.3, "it drove until the end"
    assert [r.getMessage() for r in caplog.records].count(caplog.records[-1].getMessage()) == 1
    assert "the recording ends here, the drive goes on" in caplog.text
    assert room - 15_000 < path.stat().st_size <= room
    run = RunReader(path)
    assert not run.damaged
    assert "the end is missing" in run.notices[0]
    assert "0 bytes were cut off" in run.notices[0], "no chunk in half"
    assert list(run.commands())
    repair(path)
    assert RunReader(path).complete


def test_a_piece_in_half_is_taken_back(tmp_path):
    path = tmp_path / "run.mcap"
    room = 9_001
    with RunWriter(path) as writer, room_for(room):
        for k in range(400):
            writer.rx(bytes(20), 0.01 * k)
        whole = path.stat().st_size
    assert whole < room, "the kernel took the piece up to the last byte that had room"
    assert path.stat().st_size == whole, "and the end of the run adds nothing"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_disk_that_is_full_from_the_beginning_is_refused(tmp_path, caplog):
    (tmp_path / "run.mcap").symlink_to("/dev/full")
    with pytest.raises(FileTrouble, match="No space left on device"):
        Car.open(MOCK_1_URL, record=tmp_path / "run.mcap")
    assert "goes on" not in caplog.text


@pytest.mark.slow
def test_a_disk_that_is_full_at_the_end_is_reported(tmp_path, caplog):
    """Last chunk and index are written when the car is closed."""
    path = tmp_path / "run.mcap"
    car = Car.open(MOCK_1_URL, record=path)
    for _ in car.states(duration=0.3):
        pass
    with room_for(path.stat().st_size + 100):
        car.close()
    assert isinstance(car.recorder.trouble, FileTrouble)
    assert "the recording ends here" in caplog.text


def test_a_file_that_is_deleted_is_reported(tmp_path, caplog):
    path = tmp_path / "runs" / "run.mcap"
    path.parent.mkdir()
    with Car.open(MOCK_1_URL, record=path) as car:
        path.unlink()
        path.parent.rmdir()
        for _ in car.states(duration=0.2):
            pass
    assert isinstance(car.recorder.trouble, FileTrouble)
    assert "deleted while it was written" in car.recorder.trouble.what
    assert "the drive goes on" in caplog.text


@pytest.mark.slow
def test_a_table_that_cannot_be_written_leaves_the_old_one(tmp_path):
    with Car.open(MOCK_1_URL, record=tmp_path / "run.mcap") as car:
        for _ in car.states(duration=2.0):
            pass
    table = tmp_path / "run.csv"
    table.write_text("kept\n")
    with room_for(20_000):
        found = CliRunner().invoke(replay_command, [str(tmp_path / "run.mcap"), "--out",
                                                    str(table)])
    assert found.exception is not None
    assert table.read_text() == "kept\n"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["run.csv", "run.mcap"]
