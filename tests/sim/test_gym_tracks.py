"""Tracks of the path task: closed, smooth, and the closest point is the closest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dart_hal.control.paths import Path
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_lab.sim.gym import TRACKS, DartCarEnv
from dart_lab.sim.gym.tracks import make_locate, make_point
from dart_lab.sim.light.ops import ARRAY_OPS, SCALAR_OPS


@pytest.mark.parametrize("name", TRACKS)
def test_a_track_is_closed_and_smooth(name):
    t = track_named(name)
    x, y, yaw = (np.append(v, v[0]) for v in (t.x, t.y, t.heading))
    chord = np.hypot(np.diff(x), np.diff(y))
    assert chord.max() <= t.spacing + 1e-12
    assert chord.min() > 0.999 * t.spacing
    turn = np.diff(yaw)
    turn = (turn + math.pi) % (2 * math.pi) - math.pi
    assert np.abs(turn).max() <= t.spacing * np.abs(t.curvature).max() + 1e-9


def test_the_authors_track_has_its_length():
    assert track_named("vicon").length == pytest.approx(22.92, abs=0.005)


@pytest.mark.parametrize("name", TRACKS)
def test_the_closest_point_against_brute_force(name):
    track = track_named(name)
    point, locate = make_point(track, ARRAY_OPS), make_locate(track, ARRAY_OPS)
    rng = np.random.default_rng(1)
    s = rng.uniform(0.0, track.length, 300)
    left = rng.uniform(-0.3, 0.3, 300)
    x, y, yaw, _ = point(s)
    x, y = x - left * np.sin(yaw), y + left * np.cos(yaw)
    near = s + rng.uniform(-0.1, 0.1, 300)
    found, offset, _ = locate(x, y, near)
    fine = near[:, None] + np.linspace(-0.6, 0.6, 1201)
    px, py, _, _ = point(fine)
    d = np.hypot(px - x[:, None], py - y[:, None])
    np.testing.assert_allclose(np.abs(offset), d.min(axis=1), atol=2e-3)
    np.testing.assert_allclose(found, fine[np.arange(300), d.argmin(axis=1)], atol=0.03)
    np.testing.assert_allclose(offset, left, atol=1e-4)
    assert np.quantile(np.abs(found - s), 0.9) < 2e-4


def test_one_car_and_many_find_the_same():
    track = track_named("vicon")
    many, one = make_locate(track, ARRAY_OPS), make_locate(track, SCALAR_OPS)
    x, y, s = np.array([3.0, 4.4]), np.array([0.1, 2.0]), np.array([0.8, 4.0])
    got = np.array(many(x, y, s)).T
    np.testing.assert_allclose(got, [one(x[i], y[i], s[i]) for i in range(2)], atol=1e-12)


def test_where_a_path_crosses_itself_the_car_stays_on_its_branch():
    track = track_named("eight")
    locate = make_locate(track, SCALAR_OPS)
    half = track.length / 2
    for near in (0.1, half - 0.1, half + 0.1, track.length - 0.1, track.length + 0.1):
        s, _, _ = locate(0.0, 0.02, near)
        assert abs(s - near) < 0.2


def test_arc_length_grows_over_laps():
    track = track_named("circle")
    locate, s = make_locate(track, SCALAR_OPS), 0.0
    for k in range(200):
        a = 0.1 * k
        s, _, _ = locate(math.sin(a), 1.0 - math.cos(a), s)
    assert s == pytest.approx(0.1 * 199)


def test_refusals():
    with pytest.raises(UsageError, match="not closed"):
        Path([(1.0, 0.0)], closed=True)
    with pytest.raises(UsageError, match="no track") as refused:
        track_named("ovel")
    assert refused.value.remedy.startswith("oval;")
    with pytest.raises(UsageError, match="must be closed"):
        DartCarEnv(track=Path([(2.0, 0.0)], closed=False))
