"""The motion capture of the virtual world: what it shows, how it fails, that it repeats."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url
from dart_lab.sim.backend import open_sim
from dart_lab.sim.mocap import MocapParams, SimMocap, hidden_mocap, parse_mocap
from dart_lab.sim.truth import reveal_url
from dart_lab.sim.world import Truth


class Circle:
    """A world in which the car drives 1 m/s on a circle of 1 m."""

    car = SimpleNamespace(seed=3)

    def truth(self, t):
        return Truth(t, math.sin(t), 1.0 - math.cos(t), t, 1.0, 0.0, 1.0, 0.0, t)


def rows(params, seconds=20.0, slice_s=0.01):
    source = SimMocap(Circle(), params)
    steps = round(seconds / slice_s)
    return [pose for k in range(1, steps + 1) for pose in source.poll(slice_s * k)]


def table(poses):
    return np.array([(p.stamp, p.arrival, p.x, p.y, p.yaw) for p in poses])


QUIET = MocapParams(noise=0.0, yaw_noise=0.0, jitter=0.0)


def test_it_shows_the_marker_in_the_room():
    params = replace(QUIET, lx=0.1, ly=0.02, theta=0.03, x=2.0, y=-1.0, yaw=0.5, latency=0.01,
                     offset=50.0)
    for pose in rows(params, 3.0):
        t = pose.stamp - 50.0
        car = complex(math.sin(t), 1.0 - math.cos(t))
        measured = complex(2.0, -1.0) + (car + complex(0.1, 0.02) * np.exp(1j * t)) * np.exp(0.5j)
        assert complex(pose.x, pose.y) == pytest.approx(measured, abs=1e-9)
        assert math.remainder(pose.yaw - (t + 0.5 - 0.03), math.tau) == pytest.approx(0, abs=2e-9)
        assert pose.arrival == pytest.approx(t + 0.01, abs=1e-9)


@pytest.mark.slow
def test_it_repeats_however_often_it_is_requested():
    params = replace(hidden_mocap(3), occlusion=10.0, lock=6.0, outlier=0.01)
    assert np.array_equal(table(rows(params)), table(rows(params, slice_s=0.1)))
    assert not np.array_equal(table(rows(params)), table(rows(replace(params, dropout=0.0))))


@pytest.mark.slow
def test_each_fault_shows_and_none_comes_by_itself():
    clean = table(rows(QUIET, 60.0))
    assert len(clean) == 6001
    assert np.diff(clean[:, 0]).max() < 0.0101
    lost = table(rows(replace(QUIET, dropout=0.05), 60.0))
    assert len(lost) / 6000 == pytest.approx(0.95, abs=4 * math.sqrt(0.05 * 0.95 / 6000))
    hidden = np.diff(table(rows(replace(QUIET, occlusion=10.0), 60.0))[:, 0])
    assert 3 <= (hidden > 0.1).sum() <= 17
    assert hidden.max() < 3.1  # two in a row at most, as drawn
    locked = table(rows(replace(QUIET, lock=6.0), 60.0))
    away = np.hypot(*(locked - clean)[:, 2:4].T) > 2.5
    assert 100 < away.sum() < 4000
    outliers = table(rows(replace(QUIET, outlier=0.01), 60.0))
    off = np.hypot(*(outliers - clean)[:, 2:4].T) > 0.1
    assert 30 < off.sum() < 240


@pytest.mark.slow
def test_noise_is_what_was_requested():
    measured = table(rows(replace(QUIET, noise=1e-3, yaw_noise=2e-3), 60.0))
    error = (measured - table(rows(QUIET, 60.0)))[:, 2:]
    error[:, 2] = np.remainder(error[:, 2] + math.pi, math.tau) - math.pi
    assert error.std(axis=0) == pytest.approx((1e-3, 1e-3, 2e-3), rel=0.04)


@pytest.mark.slow
def test_a_wrong_frame_shows_what_such_a_set_up_shows():
    right = table(rows(QUIET))
    tables = {frame: table(rows(replace(QUIET, frame=frame)))
              for frame in ("left", "yup", "mm", "deg", "other")}
    assert np.allclose(tables["left"][:, 2:], right[:, 2:] * (1, -1, -1))
    assert np.allclose(tables["mm"][:, 2:], right[:, 2:] * (1e3, 1e3, 1))
    assert np.allclose(tables["yup"][:, 2], right[:, 2])
    assert np.ptp(tables["yup"][:, 3]) == 0.0
    assert set(np.abs(tables["yup"][:, 4]).round(6)) == {0.0, round(math.pi, 6)}
    off = tables["deg"][:, 4] - np.degrees(right[:, 4])
    assert np.allclose(np.exp(1j * off), 1.0, atol=1e-6)
    far = np.hypot(*(tables["other"] - right)[:, 2:4].T)
    assert np.ptp(far) > 1.0
    assert all(np.array_equal(right[:, :2], t[:, :2]) for t in tables.values())


@pytest.mark.slow
def test_a_clock_that_is_set_steps_and_moves_nothing_else():
    still = table(rows(QUIET, 60.0))
    stepped = table(rows(replace(QUIET, step=10.0, offset=9.0), 60.0))
    late = stepped[:, 0] - still[:, 0] - 9.0
    jumps = np.diff(late)[np.abs(np.diff(late)) > 1e-6]
    assert 3 <= len(jumps) <= 20
    assert 0.1 < np.abs(jumps).max() <= 1.0
    assert np.array_equal(stepped[:, 1:], still[:, 1:])


def test_the_truth_shows_what_the_motion_capture_hides():
    revealed = reveal_url(Url.parse("sim://?seed=3&mocap=frame=left,step=2"))["mocap"]
    assert revealed == asdict(replace(hidden_mocap(3), frame="left", step=2.0))
    assert revealed["offset"] > 0.0
    assert reveal_url(Url.parse("sim://?seed=3"))["mocap"] is None


def test_a_seed_hides_its_marker_and_seed_0_hides_nothing():
    drawn = [hidden_mocap(seed) for seed in range(1, 40)]
    assert hidden_mocap(0) == MocapParams()
    assert len({p.lx for p in drawn}) == 39
    assert all(0.08 <= p.lx <= 0.12 and abs(p.theta) <= 0.03 for p in drawn)


def test_a_given_number_replaces_the_hidden_one():
    assert parse_mocap("rate=50,lx=-0.1", 3) == replace(hidden_mocap(3), rate=50.0, lx=-0.1)
    assert parse_mocap("0", 3) is None


@pytest.mark.parametrize("text", ["2", "rate", "rate=0", "rate=nan", "noise=-1", "rate=9,rate=9",
                                  "speed=1", "latency=2", "frame=upside", "step=61"])
def test_options_that_mean_nothing_are_refused(text):
    with pytest.raises(UsageError):
        open_sim(Url.parse(f"sim://?nano=mock&mocap={text}"))


def test_only_a_car_that_is_detected_has_poses():
    assert open_sim(Url.parse("sim://?nano=mock")).poses is None
    assert open_sim(Url.parse("sim://?nano=mock&mocap=1")).poses is not None
