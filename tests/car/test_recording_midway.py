"""A recording that begins and ends while the car drives."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import FileTrouble, UsageError
from dart_hal.recording import open_writer

pytestmark = pytest.mark.usefixtures("armed_esc")


def drive(car, seconds):
    states_of_drive = []
    for state in car.states(duration=seconds):
        car.drive(throttle=0.25, steering=0.1)
        states_of_drive.append((round(state.t, 6), state.ticks))
    return states_of_drive


@pytest.mark.slow
def test_it_replays_what_passed_meanwhile_and_nothing_else(tmp_path):
    path = tmp_path / "run.mcap"
    with Car.open("sim://?nano=mock&seed=3&mocap=1") as car:
        car.arm()
        drive(car, 0.5)
        assert car.recorder.start(path) is None
        assert car.recorder.path == path
        meanwhile = drive(car, 1.0)
        car.recorder.end()
        size = path.stat().st_size
        assert car.recorder.path is None
        drive(car, 0.5)
        assert path.stat().st_size == size
    with Car.open(f"replay://{path}") as replay:
        assert replay.hello.board_id == car.hello.board_id
        again = [(round(s.t, 6), s.ticks) for s in replay.states()]
    assert [one for one in again if one in meanwhile] == meanwhile
    assert len(again) <= len(meanwhile) + 3


def test_one_at_a_time_and_an_old_file_is_kept(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_text("old")
    with Car.open("sim://?nano=mock") as car:
        kept = car.recorder.start(path)
        assert kept is not None
        assert kept.read_text() == "old"
        with pytest.raises(UsageError, match="under way"):
            car.recorder.start(tmp_path / "other.mcap")
        car.recorder.end()
        car.recorder.end()
        car.recorder.start(tmp_path / "other.mcap")
        for _ in car.states(duration=0.2):
            pass
    with Car.open(f"replay://{tmp_path / 'other.mcap'}"):
        pass


def test_a_replay_delivers_each_state_of_a_chunk_that_came_late(tmp_path):
    """One late read of a serial port is a chunk of many frames; the callbacks get each State."""
    with Car.open("sim://?nano=mock&seed=2&fail=line:garbage=1e-4@0.5s",
                  record=tmp_path / "run.mcap") as car:
        for _ in car.states(duration=4.5):
            pass
    reported = []
    with Car.open(f"replay://{tmp_path / 'run.mcap'}") as again:
        again.on_state(reported.append)
        states = list(again.states())
    assert [state.t for state in states] == [state.t for state in reported]


def test_two_programs_do_not_write_into_one_file(tmp_path):
    path = tmp_path / "run.mcap"
    with Car.open("sim://?nano=mock", record=path), pytest.raises(FileTrouble,
                                                                        match="exists"):
        open_writer(path)
