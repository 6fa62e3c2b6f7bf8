"""``State.estimate``: where the car is and how it moves, and never confident of a wrong place."""

from __future__ import annotations

from math import cos, hypot, sin

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.car.telemetry import Telemetry
from dart_hal.core.types import START_FRAME, Tracking
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.mocap import parse_mocap
from dart_lab.sim.truth import truth
from tests.common import KINEMATIC_3_URL

MOCAP = "rate=10,noise=0.005,yaw_noise=0.005"
FAR = 16.27
"""Normalised error squared (3) of one honest estimate in a thousand."""


def drive(url, seconds, mocap=""):
    """(State, true x, y, yaw of the axle: in the room, or from the start) of each frame."""
    backend = open_backend(f"{url}&mocap={mocap}" if mocap else url)
    rows = []
    room = parse_mocap(mocap, 3) if mocap else None
    with Car.over(backend) as car:
        car.arm()
        for state in car.states(duration=seconds):
            real = truth(backend, state.t)
            place = real.x, real.y, real.yaw
            if room is not None:
                c = cos(room.yaw)
                s = sin(room.yaw)
                place = (room.x + c * real.x - s * real.y, room.y + s * real.x + c * real.y,
                         room.yaw + real.yaw)
            rows.append((state, place))
            car.drive(steering=0.2 * sin(state.t), throttle=0.25)
    return rows


def off(pose, place):
    """Normalised error squared of x and y."""
    error = np.array((pose.x - place[0], pose.y - place[1]))
    return float(error @ np.linalg.solve(pose.cov[:2, :2] + 1e-6 * np.eye(2), error))


@pytest.mark.slow
def test_without_a_source_it_is_dead_reckoning():
    for state, _ in drive(KINEMATIC_3_URL, 0.5):
        estimate = state.estimate
        assert (estimate.frame, estimate.tracking) == (START_FRAME, Tracking.DEAD_RECKONING)
        assert estimate.pose is state.pose
        assert (estimate.t, estimate.speed, estimate.yaw_rate) == (state.t, state.speed,
                                                                   state.yaw_rate)
        assert np.sqrt(estimate.cov[3, 3]) == pytest.approx(state.speed_std)


@pytest.mark.slow
def test_with_a_source_it_is_the_axle_in_the_room():
    rows = [(state.estimate, place) for state, place in drive(KINEMATIC_3_URL, 4.0, MOCAP)]
    assert {e.frame for e, _ in rows} == {"mocap"}
    assert max(off(e.pose, place) for e, place in rows) < FAR
    last, place = rows[-1]
    assert hypot(last.pose.x - place[0], last.pose.y - place[1]) < 0.05
    assert last.speed > 0.2


@pytest.mark.slow
def test_its_covariance_grows_while_no_pose_arrives():
    rows = [(s.estimate, place) for s,
            place in drive(KINEMATIC_3_URL, 6.0, f"{MOCAP},occlusion=30")]
    hidden = [e.tracking is Tracking.DEAD_RECKONING for e, _ in rows]
    variances = [float(np.trace(e.pose.cov[:2, :2])) for e, _ in rows]
    driven = [(a, b) for a, b, h,
              (e, _) in zip(variances, variances[1:], hidden[1:], rows[1:], strict=False)
              if h and e.speed > 0.2]
    assert len(driven) > 20, "never hidden while driving: this shows nothing"
    assert all(b > a for a, b in driven)
    assert max(off(e.pose, place) for e, place in rows) < FAR


@pytest.mark.slow
def test_a_false_lock_does_not_move_it():
    rows = drive(KINEMATIC_3_URL, 8.0, f"{MOCAP},lock=20")
    fooled = [(s.estimate, place) for s, place in rows
              if hypot(s.external.newest.x - place[0], s.external.newest.y - place[1]) > 2.0]
    in_room = [(e, place) for e, place in fooled if e.frame != START_FRAME]
    assert any(e.speed > 0.3 for e, _ in in_room), "no false lock: this would show nothing"
    assert len(in_room) < len(fooled), "not locked from the first"
    assert {e.tracking for e, _ in fooled} <= {Tracking.JUMPED, Tracking.DEAD_RECKONING}
    assert max(off(e.pose, place) for e, place in in_room) < FAR


@pytest.mark.slow
def test_a_clock_that_is_set_does_not_move_it():
    rows = [(s.estimate, place) for s, place in drive(KINEMATIC_3_URL, 5.0, "noise=0.002,step=60")]
    assert any(e.tracking is not Tracking.TRACKING for e, _ in rows), "it was never set"
    assert max(off(e.pose, place) for e, place in rows) < FAR


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["enc:off@4", "enc:wrong=0.5@4"])
def test_dead_reckoning_with_a_doubted_encoder_has_a_large_covariance(fault, monkeypatch):
    def worst():
        rows = drive(f"{KINEMATIC_3_URL}&fail={fault}", 4.0)
        assert any(s.health.doubts for s, _ in rows)
        return max(off(s.estimate.pose, place) for s, place in rows
                   if s.health.doubts or s.t < 4.0)

    assert worst() < FAR
    monkeypatch.setattr(Telemetry, "_undetected_speed", lambda self, speed, std: 0.0)
    assert worst() > FAR, "the doubt makes no difference"


@pytest.mark.slow
def test_ahead_it_goes_on_along_its_arc():
    state = drive(KINEMATIC_3_URL, 3.0)[-1][0]
    now = state.estimate
    soon = now.predict(state.t + 0.1)
    assert soon.t == pytest.approx(state.t + 0.1)
    assert hypot(soon.pose.x - now.pose.x, soon.pose.y - now.pose.y) == pytest.approx(
        0.1 * now.speed)
    assert soon.pose.yaw - now.pose.yaw == pytest.approx(0.1 * now.yaw_rate)
    assert (np.diag(soon.cov) > np.diag(now.cov)).all()
    assert np.linalg.eigvalsh(soon.cov)[0] > 0.0
    assert now.predict(state.t - 1.0) is now
    assert now.predict(state.t + 99.0).t == pytest.approx(state.t + 0.5)


def test_the_present_moment_is_on_the_clock_of_the_states():
    """A State is 1 to 2 ms old when it arrives; by then the car has gone on."""
    with Car.open("sim://?nano=mock") as car:
        for _ in car.states(duration=0.2):  # what came while it was opened
            pass
        for state in car.states(duration=0.2):
            assert 0.0005 < car.now - state.t < 0.005
            assert state.estimate.predict(car.now).t == car.now
