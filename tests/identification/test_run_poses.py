"""Runs with poses from outside are read as the published recordings are."""

from __future__ import annotations

from math import sin

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.car.run_poses import mocap_from_poses
from dart_hal.car.runs import read_run
from dart_hal.core.errors import RecordingError
from dart_hal.core.types import ExternalPose
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.source_clock import to_car_time
from dart_hal.recording.dart import fit_reference
from dart_lab.identification.evaluation.cases import prepare
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import truth


def drive(url, path, seconds):
    """A winding drive; what the car really did at some times."""
    backend = open_backend(url)
    true = []
    with Car.over(backend, record=path) as car:
        car.arm()
        for state in car.states(duration=seconds):
            car.drive(steering=0.2 * sin(state.t), throttle=0.23)
            if state.seq % 20 == 0:
                true.append(truth(backend))
    return true


@pytest.fixture(scope="module")
def run_with_poses(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    return path, drive("sim://?seed=3&nano=mock&physics=kinematic&mocap=1", path, 10.0)


@pytest.mark.slow
def test_the_mocap_of_a_run_shows_what_the_car_did(run_with_poses):
    path, true = run_with_poses
    recording, hidden = read_run(path), hidden_mocap(3)
    mocap, messages = recording.mocap, recording.messages
    assert len(mocap) > 1000
    assert mocap.epoch is None
    start = messages.t[0] - messages.arrival[0]  # car's time of the first row
    assert np.ptp(messages.t - messages.arrival) < 1e-9
    for real in true:
        # the least latency is not observable: the row is of that much earlier
        t = real.t - start + hidden.latency
        yaw = np.interp(t, mocap.t, mocap.yaw)
        assert np.remainder(yaw - (real.yaw + hidden.yaw - hidden.theta) + np.pi,
                            2 * np.pi) - np.pi == pytest.approx(0.0, abs=0.006)
        axle = complex(real.x, real.y) + complex(hidden.lx, hidden.ly) * np.exp(1j * real.yaw)
        there = complex(hidden.x, hidden.y) + axle * np.exp(1j * hidden.yaw)
        here = complex(np.interp(t, mocap.t, mocap.x), np.interp(t, mocap.t, mocap.y))
        assert abs(here - there) < 0.004


@pytest.mark.slow
def test_its_messages_are_of_the_moment(run_with_poses):
    path, true = run_with_poses
    m = read_run(path).messages
    t = np.array([real.t for real in true])
    rate = np.array([real.yaw_rate for real in true])

    def time_offset(stamp, value):
        """s by which a series comes later than the truth, least squares along its slope."""
        slope = np.interp(t + 0.02, stamp, value) - np.interp(t - 0.02, stamp, value)
        off = rate - np.interp(t, stamp, value)
        return 0.04 * (off @ slope) / (slope @ slope)

    assert time_offset(m.t, m.yaw_rate) == pytest.approx(0.0, abs=0.006)
    means = read_run(path, poses=False)
    assert means.mocap is None
    assert time_offset(means.messages.t, means.messages.yaw_rate) == pytest.approx(0.05, abs=0.01)
    assert np.median(np.diff(m.t)) == pytest.approx(0.02, abs=1e-3)


@pytest.mark.slow
def test_it_is_evaluated_and_its_marker_found(run_with_poses):
    recording = read_run(run_with_poses[0])
    case, = prepare([recording]).cases
    assert len(case) > 5
    found, hidden = fit_reference([recording]), hidden_mocap(3)
    assert found.lx == pytest.approx(hidden.lx, abs=0.01)
    assert found.theta == pytest.approx(hidden.theta, abs=0.01)


@pytest.mark.slow
def test_how_far_aside_its_marker_sat_is_reported_by_the_wheels(run_with_poses):
    marker, hidden = read_run(run_with_poses[0]).marker, hidden_mocap(3)
    assert abs(hidden.ly) > 0.006
    assert marker.ly == pytest.approx(hidden.ly, abs=0.0015)


@pytest.mark.slow
def test_a_run_without_poses_is_refused_with_the_way_to_get_them(tmp_path):
    path = tmp_path / "run.mcap"
    drive("sim://?seed=3&nano=mock&physics=kinematic", path, 2.0)
    with pytest.raises(RecordingError) as refused:
        prepare([read_run(path)])
    assert "mocap=1" in refused.value.remedy
    with pytest.raises(RecordingError):
        prepare([read_run(path)], named=[path])


def poses(stamp, arrival):
    return [ExternalPose(s, a, 0.01 * k, 0.0, 0.0)
            for k, (s, a) in enumerate(zip(stamp, arrival, strict=True))]


def test_a_clock_that_runs_faster_is_followed_and_late_rows_do_not_matter():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 0.01)
    arrival = t + 0.004 + rng.exponential(0.003, len(t))
    car_time, notes = to_car_time(1e5 + t * (1 + 2e-4), arrival)
    assert not notes
    assert np.abs(car_time - t - 0.004).max() < 1e-3


def test_a_source_that_began_again_is_reported_by_its_arrival():
    stamp = np.concatenate([np.arange(100.0, 110.0, 0.01), np.arange(0.0, 10.0, 0.01)])
    arrival = np.arange(len(stamp)) * 0.01 + 0.5
    car_time, notes = to_car_time(stamp, arrival)
    assert np.array_equal(car_time, arrival)
    assert "restarted its clock" in notes


def test_the_date_of_a_run_is_that_of_its_source():
    t = np.arange(0.0, 1.0, 0.01)
    mocap, start, _ = mocap_from_poses(poses(1.75e9 + t, 5.0 + t))
    assert mocap.epoch == 1.75e9
    assert start == pytest.approx(5.0, abs=1e-6)
    assert mocap_from_poses(poses(t, t)[:29]) is None
