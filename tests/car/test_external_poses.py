"""A car with external poses: States have its place in the room, and replay the same."""

from __future__ import annotations

from itertools import pairwise
from math import cos, hypot, sin

import pytest

from dart_hal.car import Car
from dart_hal.core.types import Tracking
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.run import RunReader
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import truth
from tests.common import KINEMATIC_3_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


def drive(url, seconds, record=None):
    """(State, true place of the marker in the room) of each frame while it drives."""
    backend = open_backend(url)
    hidden = hidden_mocap(3)
    rows = []
    with Car.over(backend, record=record) as car:
        car.arm()
        for state in car.states(duration=seconds):
            real = truth(backend, state.t)
            c = cos(real.yaw)
            s = sin(real.yaw)
            x = real.x + hidden.lx * c - hidden.ly * s
            y = real.y + hidden.lx * s + hidden.ly * c
            c = cos(hidden.yaw)
            s = sin(hidden.yaw)
            rows.append((state, hidden.x + c * x - s * y, hidden.y + s * x + c * y))
            car.drive(steering=0.2 * sin(state.t), throttle=0.25)
    return rows


def flat(state):
    e = state.external
    pose = None if e.pose is None else (e.pose.x, e.pose.y, e.pose.yaw, e.pose.cov.tobytes())
    newest = e.newest and (e.newest.stamp, e.newest.arrival, e.newest.x, e.newest.yaw,
                           e.newest.cov.tobytes())
    rows = state.estimate.predict(state.t + 0.02)
    best = (rows.t, rows.pose.x, rows.pose.y, rows.pose.yaw, rows.speed, rows.yaw_rate,
            rows.cov.tobytes(), rows.frame)
    return state.t, e.tracking, e.age, pose, newest, best


@pytest.mark.slow
def test_states_know_the_place_in_the_room_and_a_replay_knows_the_same(tmp_path):
    path = tmp_path / "run.mcap"
    rows = drive(f"{KINEMATIC_3_URL}&mocap=1", 1.5, path)
    late = hidden_mocap(3).latency
    for state, x, y in rows:
        assert state.external.tracking is Tracking.TRACKING
        assert state.estimate.frame == "mocap"
        # the clock of the source is known to its least latency
        assert hypot(state.external.pose.x - x, state.external.pose.y - y) < (
            0.01 + state.speed * (late + 0.001))
    live = {state.seq: flat(state) for state, _, _ in rows}
    with Car.open(f"replay://{path}") as car:
        again = {state.seq: flat(state) for state in car.states()}
    assert all(again[seq] == before for seq, before in live.items())


@pytest.mark.slow
def test_under_a_false_lock_the_car_is_not_where_the_motion_capture_reports():
    rows = drive(f"{KINEMATIC_3_URL}&mocap=lock=20", 8.0)
    fooled = [(s, x, y) for s, x, y in rows
              if hypot(s.external.newest.x - x, s.external.newest.y - y) > 2.0 and s.speed > 0.3]
    assert fooled, "no false lock while driving: this test would show nothing"
    assert all(s.external.tracking is Tracking.JUMPED for s, _, _ in fooled)
    assert all(hypot(s.external.pose.x - x, s.external.pose.y - y) < 0.3 for s, x, y in fooled)


@pytest.mark.slow
def test_a_clock_that_is_set_does_not_move_the_car(tmp_path):
    path = tmp_path / "run.mcap"
    rows = drive(f"{KINEMATIC_3_URL}&mocap=step=40", 6.0, path)
    raw = [p.stamp for p in RunReader(path).poses()]
    assert min(b - a for a, b in pairwise(raw)) < -0.2, "never set back: this shows nothing"
    assert all(hypot(s.external.pose.x - x, s.external.pose.y - y) < 0.06 for s, x, y in rows)
    assert {s.external.tracking for s, _, _ in rows} <= {Tracking.TRACKING, Tracking.DEAD_RECKONING}


def test_a_car_without_poses_reports_it():
    with Car.open(KINEMATIC_3_URL) as car:
        state = next(car.states())
    assert state.external is None
