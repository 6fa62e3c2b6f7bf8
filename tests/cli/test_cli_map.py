"""``dart-hal map``: what it writes, prints and refuses, and the pin when it is interrupted."""

from __future__ import annotations

import signal

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.estimation.localisation.grid import read_grid
from dart_lab.sim.lidar.maps import room_of
from dart_lab.sim.lidar.unit import SimLidar
from dart_lab.sim.world import THROTTLE_CHANNEL, World
from tests.common import MAPPED_ROOM_URL, NEUTRAL_TOLERANCE_US, NEUTRAL_US

pytestmark = pytest.mark.usefixtures("armed_esc")
WAIVE_OPTIONS = ("--waive", "CALIBRATION_MISSING", "--waive", "PWM_CLOCK_UNCALIBRATED")


@pytest.mark.slow
def test_a_room_is_driven_mapped_drawn_and_the_recording_localised_in_it(verb, tmp_path):
    out = tmp_path / "room.yaml"
    picture = tmp_path / "room.png"
    done = verb("map", out, "--speed", 1, "--distance", 12, "--url", MAPPED_ROOM_URL, "--plot",
                picture,
                *WAIVE_OPTIONS, "--json")
    assert done.code == 0, done.err
    assert done.json["ended"] == "12 m are driven"
    assert done.json["explained"] > 0.9
    assert done.json["files"].keys() == {"map", "image", "recording", "plot"}
    assert picture.stat().st_size > 10_000
    grid = read_grid(out)
    true = room_of("room", 0)
    length = np.hypot(*(true.lines[:, 2:] - true.lines[:, :2]).T).sum()
    assert 0.6 * length < 0.02 * grid.occupied.sum() < 1.3 * length
    run = done.json["files"]["recording"]
    again = verb("localize", "--url", f"replay://{run}", "--map", out, "--json")
    assert again.code == 0
    assert again.json["agreement"] > 0.85
    twice = verb("map", tmp_path / "again.yaml", "--run", run, "--json")
    assert (tmp_path / "again.pgm").read_bytes() == (tmp_path / "room.pgm").read_bytes()
    assert twice.json["walls_cells"] == done.json["walls_cells"]


@pytest.fixture
def run_and_interrupt(verb, monkeypatch, tmp_path):
    """(output of the verb, pulses [us] up to and after Ctrl-C), at the 400th that moves the car."""
    def run():
        before = []
        after = []
        made = World.__init__

        def watch(channel, pulse):
            if channel != THROTTLE_CHANNEL:
                return
            us = 1e6 * (pulse[1] - pulse[0])
            (after if moving() >= 400 else before).append(us)
            if not after and moving() == 400:
                signal.raise_signal(signal.SIGINT)

        def moving():
            return sum(abs(us - NEUTRAL_US) > NEUTRAL_TOLERANCE_US for us in before)

        def make_watched_world(world, *args, **options):
            made(world, *args, **options)
            world.watchers.append(watch)

        monkeypatch.setattr(World, "__init__", make_watched_world)
        handler = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            done = verb("map", tmp_path / "room.yaml", "--speed", 0.6, "--url", MAPPED_ROOM_URL,
                        *WAIVE_OPTIONS,
                        "--json")
        finally:
            signal.signal(signal.SIGINT, handler)
        return done, before, after

    return run


@pytest.mark.slow
def test_ctrl_c_stops_the_car_and_what_was_driven_is_mapped(run_and_interrupt, tmp_path):
    done, before, after = run_and_interrupt()
    assert done.code == 0, done.err
    assert done.json["ended"] == "stopped by Ctrl-C"
    assert read_grid(tmp_path / "room.yaml").occupied.sum() > 500
    assert max(before) > NEUTRAL_US + 20.0
    assert all(abs(us - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US for us in after[2:])  # 40 ms
    assert abs((before + after)[-1] - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US


@pytest.mark.slow
def test_without_neutral_at_the_end_it_drives_on(run_and_interrupt, monkeypatch):
    """Control: a close that leaves the pins as they are."""
    monkeypatch.setattr("dart_hal.car.driver.Driver.close", lambda driver, now: None)
    monkeypatch.setattr("dart_hal.devices.actuation.chain.Actuator.stop",
                        lambda actuator: actuator.applied)
    _, before, after = run_and_interrupt()
    assert abs((before + after)[-1] - NEUTRAL_US) > NEUTRAL_TOLERANCE_US


@pytest.mark.slow
def test_a_lidar_upside_down_stops_the_drive_and_makes_no_map(verb, tmp_path):
    done = verb("map", tmp_path / "room.yaml", "--speed", 0.6, "--distance", 20, "--url",
                MAPPED_ROOM_URL.replace("lidar=1", "lidar=clockwise=0"), *WAIVE_OPTIONS)
    assert done.code == 2
    assert "the scans turn against the gyro" in done.err
    assert not (tmp_path / "room.yaml").exists()


@pytest.mark.parametrize(("args", "message"), [
    (("--speed", 1, "--url", "sim://?nano=mock"), "has no lidar"),
    (("--speed", 1, "--keyboard"), "exactly one way to drive the room is required"),
    ((), "exactly one way to drive the room is required"),
    (("--run", "nothing.mcap"), "nothing.mcap")])
def test_what_cannot_be(verb, tmp_path, args, message):
    done = verb("map", tmp_path / "room.yaml", *args)
    assert done.code == 2
    assert message in done.err


def test_a_map_is_called_yaml(verb, tmp_path):
    done = verb("map", tmp_path / "room.png", "--speed", 1)
    assert done.code == 2
    assert "room.yaml" in done.err


@pytest.mark.slow
def test_a_lidar_that_dies_at_once_gives_a_reason_and_no_map(verb, tmp_path, monkeypatch):
    run = tmp_path / "run.mcap"
    poll = SimLidar.poll
    monkeypatch.setattr(SimLidar, "poll", lambda source, now: [
        scan for scan in poll(source, now) if scan.arrival < 0.3])
    with Car.open(MAPPED_ROOM_URL, record=run) as car:
        car.arm(waive=("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED"))
        for _ in car.states(duration=3.0):
            car.drive_speed(steering=0.3, speed=1.0)
    done = verb("map", tmp_path / "room.yaml", "--run", run)
    assert done.code == 2
    assert "the scans are too few for a map" in done.err
    assert not (tmp_path / "room.yaml").exists()
