"""Stamps count from 1970, and still a replay sees the car's own clock to the last bit."""

from __future__ import annotations

import time
from datetime import datetime, timezone

import pytest
from mcap.reader import make_reader

from dart_hal.car import Car
from dart_hal.recording.repair import repair
from dart_hal.recording.run import RunReader, RunWriter
from tests.ros2msg import decode_messages

THIRD = 100.0 + 1 / 3 + 0.5e-9
"""s: 100_333_333_333.8 ns."""


@pytest.fixture
def began():
    """ns since 1970, before anything of the test."""
    return time.time_ns()


def written(path, state, *, close=True):
    """A run of a car whose clock shows 100 s now."""
    writer = RunWriter(path, start=100.0, now=100.0)
    for k in range(12):
        writer.rx(bytes([k]), THIRD + 0.01 * k)
        writer.state(state(k, t=THIRD + 0.01 * k))
    if close:
        writer.close()
    return writer


def check(path):
    run = RunReader(path)
    assert [c.t for c in run.chunks()] == [THIRD + 0.01 * k for k in range(12)]
    return run


def test_the_file_has_the_hour_and_the_reader_the_clock(tmp_path, state, began):
    path = tmp_path / "run.mcap"
    written(path, state)
    run = check(path)
    assert 0 <= run.zero_ns - (began - 100 * 10**9) < 5e9
    with path.open("rb") as file:
        stamps = [m.log_time for _, c, m in make_reader(file).iter_messages() if c.topic == "/odom"]
    assert stamps[0] == run.zero_ns + 100_333_333_333
    for stamp, odom in zip(stamps, decode_messages(path, "/odom"), strict=True):
        assert odom["header.stamp.sec"] * 10**9 + odom["header.stamp.nanosec"] == stamp
    day = datetime.fromtimestamp(stamps[0] // 10**9, timezone.utc)
    assert f"{day:%Y-%m-%d %H:%M:%S} UTC" in repr(run)
    assert "lasts 0.1 s" in repr(run)


def test_virtual_time_has_no_calendar(run_file):
    run = RunReader(run_file)
    assert run.zero_ns == 0
    assert "UTC" not in repr(run)


def test_a_killed_run_keeps_its_calendar(tmp_path, state):
    path = tmp_path / "killed.mcap"
    whole = tmp_path / "run.mcap"
    writer = written(whole, state, close=False)
    writer._file.flush()
    path.write_bytes(whole.read_bytes())
    writer.close()
    zero = check(path).zero_ns
    repair(path)
    assert check(path).zero_ns == zero == RunReader(whole).zero_ns > 0


def test_a_run_that_lost_its_first_chunk_or_its_facts_keeps_it(tmp_path, state):
    """Each channel has it, in the index too."""
    path = tmp_path / "run.mcap"
    written(path, state)
    zero = RunReader(path).zero_ns
    data = bytearray(path.read_bytes())
    for mark in (b'"proto"', b"/rx"):
        data[data.index(mark)] ^= 1
        path.write_bytes(data)
        run = RunReader(path)
        assert run.damaged
        assert run.zero_ns == zero
        assert [c.t for c in run.chunks()] == [THIRD + 0.01 * k for k in range(12)][-len(
            list(run.chunks())):]
    assert run.meta == {}, "else this shows nothing of the facts"


@pytest.mark.slow
def test_a_car_in_real_time_is_replayed_to_the_bit(tmp_path, began):
    path = tmp_path / "run.mcap"
    states = []
    with Car.open("sim://?seed=1&nano=mock&pace=1", record=path) as car:
        car.on_state(states.append)
        for _ in car.states(duration=0.3):
            pass
    assert RunReader(path).zero_ns > began - 60 * 10**9
    with Car.open(f"replay://{path}") as car:
        again = list(car.states())
    assert len(states) > 25
    assert {(s.t, s.speed, s.pose.x) for s in states} <= {(s.t, s.speed, s.pose.x) for s in again}
