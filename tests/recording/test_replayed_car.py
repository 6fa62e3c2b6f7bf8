"""A car replayed from its recording gives the very States of the run."""

from __future__ import annotations

import math

import pytest

from dart_hal.car import Car
from dart_hal.recording.run import RunReader
from tests.common import MOCK_3_URL


def flat(state):
    pose = state.pose
    applied = state.applied
    health = state.health
    return (state.t, state.seq, state.speed, state.speed_std, state.yaw_rate, state.accel_x,
            state.accel_y, state.ticks, pose.x, pose.y, pose.yaw, pose.cov.tobytes(), applied,
            health)


def drive_and_record(path):
    states = []
    with Car.open(MOCK_3_URL, record=path) as car:
        car.arm()
        for state in car.states(duration=3.0):
            states.append(state)
            car.drive(steering=0.25 * math.sin(2 * state.t), throttle=0.2)
    return states


@pytest.fixture(scope="module")
def recorded_run(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    return path, drive_and_record(path)


@pytest.mark.slow
def test_replayed_states_are_identical(recorded_run):
    path, states = recorded_run
    with Car.open(f"replay://{path}") as car:
        replayed = {s.seq: flat(s) for s in car.states()}
    assert len(states) > 290
    assert [replayed[s.seq] for s in states] == [flat(s) for s in states]
    assert states[-1].speed > 0.2


@pytest.mark.slow
def test_replay_without_the_recorded_pulses_would_differ(recorded_run):
    _, states = recorded_run
    assert len({s.applied for s in states}) > 10


@pytest.mark.slow
def test_the_run_holds_who_and_what(recorded_run):
    run = RunReader(recorded_run[0])
    assert run.complete
    assert run.meta["url"] == MOCK_3_URL
    assert "car.toml" in run.files
    assert run.hello is not None
    assert len(list(run.commands())) > 290
    assert len(list(run.sent())) > 100


@pytest.mark.slow
def test_the_same_run_twice_gives_the_same_file(recorded_run, tmp_path):
    path = tmp_path / "again.mcap"
    drive_and_record(path)
    assert path.read_bytes() == recorded_run[0].read_bytes()
