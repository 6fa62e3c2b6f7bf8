"""A page that begins a recording, and numbers of the program that it plots."""

from __future__ import annotations

import json
import resource
from contextlib import contextmanager

import pytest

from dart_hal.car import Car
from dart_hal.recording.run import RunReader
from dart_lab.live.view import messages as m
from tests.live.view.at_the_desk import AtTheDesk


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
def test_a_recording_that_a_page_begins_is_a_run(tmp_path):
    with AtTheDesk(folder=tmp_path) as at:
        at.take_and_arm()
        at.send_message("one", m.Record(True))
        at.drive(1.0, lambda t: at.hold())
        assert at.messages[-1]["type"]
        status = [one for one in at.messages if one["type"] == "status"][-1]
        (path,) = tmp_path.glob("run_*.mcap")
        assert status["recording"] == path.name
        at.send_message("one", m.Record(False))
        at.drive(0.3)
        assert [one for one in at.messages if one["type"] == "status"][-1]["recording"] == ""
    with Car.open(f"replay://{path}") as replay:
        assert sum(state.speed > 0.1 for state in replay.states()) > 30


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with AtTheDesk(folder=tmp_path / "file") as at:
        at.take_and_arm()
        at.send_message("one", m.Record(True))
        at.drive(0.5, lambda t: at.hold())
        assert any("no recording" in text for text in at.list_texts())
        assert at.driving(at.now() - 0.1), "it drives on"


@pytest.mark.slow
def test_a_disk_that_fills_up_is_reported_and_the_car_drives_on(tmp_path):
    with AtTheDesk(folder=tmp_path) as at:
        at.take_and_arm()
        at.send_message("one", m.Record(True))
        at.drive(0.2, lambda t: at.hold())
        with room_for(60_000):
            at.drive(1.5, lambda t: at.hold())
            status = [one for one in at.messages if one["type"] == "status"][-1]
        assert "large" in status["trouble"]  # "File too large": the kernel's message
        assert at.car.mode == "ARMED"
        assert at.driving(at.now() - 0.1), "it drives on"
        at.send_message("one", m.Record(False))
        at.drive(0.3, lambda t: at.hold())
        assert [one for one in at.messages if one["type"] == "status"][-1]["trouble"] == ""
        (path,) = tmp_path.glob("run_*.mcap")
    assert path.stat().st_size <= 60_000
    assert not RunReader(path).damaged, "what fitted can be read"


def test_numbers_that_the_program_logs_are_sent_when_they_change():
    with AtTheDesk(drives=False) as at:
        at.car.log("mpc/cost", 3.5)
        at.car.log("mpc/plan", [1.0, 2.0])
        at.drive(0.2)
        at.drive(0.2)
        logs = [one["values"] for one in at.messages if one["type"] == "log"]
        assert logs == [{"mpc/cost": 3.5}]


@pytest.mark.slow
def test_a_viewer_on_a_dead_link_is_informed_and_again_when_it_is_back():
    with AtTheDesk(url="sim://?nano=mock&seed=1&fail=line:off@6s+2s") as at:
        at.take_and_arm()
        at.drive(6.5 - at.now(), lambda t: at.hold())
        batch = list(at.desk.batch())
        assert at.now() > 6.4
        status = [one for one in map(json.loads, batch) if one["type"] == "status"][-1]
        assert "no frame" in status["trouble"]
        assert status["mode"] != "ARMED"
        at.drive(3.0)
        assert [one for one in at.messages if one["type"] == "status"][-1]["trouble"] == ""
