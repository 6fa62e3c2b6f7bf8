"""Paths and pure pursuit: geometry that can be checked by hand."""

from __future__ import annotations

from math import atan, cos, pi, sin

import numpy as np
import pytest

from dart_hal.control.paths import Path, figure_of_eight
from dart_hal.control.pursuit import PurePursuit
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Pose

WHEELBASE = 0.175


def test_a_circle_has_its_radius_and_closes():
    circle = Path([(2 * pi * 1.5, 1 / 1.5)], closed=True)
    assert circle.length == pytest.approx(2 * pi * 1.5)
    assert np.hypot(circle.x, circle.y - 1.5) == pytest.approx(np.full(len(circle.x), 1.5),
                                                              abs=1e-9)
    assert circle.point(circle.length) == circle.point(0.0)


def test_a_path_backwards_is_the_same_way():
    """Closed, and open with a bend and speeds; twice backwards is forwards."""
    ring = Path([(pi, 1.0), (1.0, 0.0), (pi, 1.0), (1.0, 0.0)], closed=True)
    back = ring.reversed()
    assert back.point(0.0) == pytest.approx(ring.point(0.0), abs=1e-9)
    assert back.point(1.5) == pytest.approx(ring.point(-1.5), abs=1e-9)
    assert back.curvature.min() == pytest.approx(-1.0)
    assert np.cos(back.reversed().heading - ring.heading).min() > 1.0 - 1e-12
    open_ = Path.through([(0, 0), (1, 0), (2, 1)], closed=False, speed=np.array((1.0, 1.0, 2.0)))
    back = open_.reversed()
    assert back.point(0.0) == pytest.approx((2.0, 1.0), abs=1e-3)
    assert back.point(back.length) == pytest.approx((0.0, 0.0), abs=1e-3)
    assert (back.speed[0], back.speed[-1]) == pytest.approx((2.0, 1.0), abs=0.03)
    offset = back.offset(1.0, 0.3, back.closest(1.0, 0.3, 1.4))
    assert offset == pytest.approx(-open_.offset(1.0, 0.3, open_.closest(1.0, 0.3, 1.0)), abs=1e-3)


def test_a_straight_has_no_radius_and_an_end():
    straight = Path([(2.0, 0.0)], closed=False, start=(1.0, 2.0, pi / 2))
    assert straight.point(99.0)[1] == pytest.approx(4.0, abs=0.03)
    assert straight.point(-1.0) == pytest.approx((1.0, 2.0))


@pytest.mark.parametrize("part", [0.001, 0.011, 0.029])
def test_a_path_of_short_pieces_is_where_it_should_be(part):
    """Points are where their arc length puts them, however the path is cut into pieces."""
    path = Path([(part, 0.0)] * 100 + [(2.9, 0.0)], closed=False)
    for s in (0.0, part, 1.0, 50 * part + 1.0, 2.9):
        assert path.point(s)[0] == pytest.approx(s, abs=path.spacing)
        there = min(s + 0.5, path.length)
        assert path.closest(there, 0.1, s) == pytest.approx(there, abs=1.01 * path.spacing)


def test_behind_its_end_an_open_path_is_left_of_where_it_ended():
    path = Path([(2.0, 0.0), (0.5 * pi, 1.0)], closed=False)
    x, y = path.point(99.0)
    assert path.offset(x - 0.2, y, 99.0) == pytest.approx(0.2, abs=0.01)


def test_the_eight_is_symmetric():
    eight = figure_of_eight(0.9)
    half = len(eight.x) // 2
    assert eight.y[:half] == pytest.approx(-eight.y[half:], abs=1e-9)
    assert eight.y[:half].min() > -1e-9


def test_points_are_equidistant_and_the_curvature_changes_where_a_segment_ends():
    path = Path([(1.01, 0.0), (0.5 * pi, 1.0)], closed=False)
    assert np.diff(path.s) == pytest.approx(path.spacing)
    assert path.curvature.tolist() == [float(s >= 1.01) for s in path.s]
    late = path.s >= 1.01
    assert np.hypot(path.x[late] - 1.01, path.y[late] - 1.0) == pytest.approx(1.0)


@pytest.mark.parametrize("segments", [
    [], [(1.0, 0.0, 2.0)], [1.0, 2.0], [(0.0, 0.0)], [(-1.0, 0.5)], [(1.0, float("nan"))]])
def test_what_is_no_segment_is_refused(segments):
    with pytest.raises(UsageError, match="needs segments") as refused:
        Path(segments, closed=False)
    assert "Path.through" in refused.value.remedy


@pytest.mark.parametrize("radius", [0.0, -0.9, float("nan"), float("inf")])
def test_a_circle_without_a_radius_is_refused(radius):
    with pytest.raises(UsageError, match="needs a radius"):
        figure_of_eight(radius)


def test_a_closed_path_has_no_gap():
    with pytest.raises(UsageError, match="not closed"):
        Path([(1.0, 0.0)], closed=True)
    with pytest.raises(UsageError, match="not closed"):
        Path([(2.0 * pi, 1.0), (0.5 * pi, 1.0), (0.5 * pi, -1.0)], closed=True)


def test_left_of_the_path_is_positive():
    straight = Path([(4.0, 0.0)], closed=False)
    s = straight.closest(1.0, 0.3, 0.9)
    assert s == pytest.approx(1.0, abs=0.02)
    assert straight.offset(1.0, 0.3, s) == pytest.approx(0.3)
    assert straight.offset(1.0, -0.3, s) == pytest.approx(-0.3)


def test_the_closest_point_never_jumps_to_the_other_branch():
    """At its crossing the eight has two points in one place."""
    eight = figure_of_eight(0.9)
    assert eight.closest(0.0, 0.0, eight.length / 2) == pytest.approx(eight.length / 2, abs=0.03)
    assert eight.closest(0.0, 0.0, eight.length) == pytest.approx(eight.length, abs=0.03)


def follow(path, x, y, yaw, speed=0.6, seconds=20.0, delay=0.0):
    """A kinematic car of ours, 100 Hz; offsets of the last third."""
    pursuit = PurePursuit(path, WHEELBASE, delay=delay)
    offsets = []
    rate = 0.0
    for _ in range(int(seconds * 100)):
        angle = pursuit.steer(Pose(x, y, yaw), speed, rate)
        angle = min(max(angle, -0.4), 0.4)
        rate = speed * np.tan(angle) / WHEELBASE
        x = x + speed * 0.01 * cos(yaw)
        y = y + speed * 0.01 * sin(yaw)
        yaw += rate * 0.01
        offsets.append(pursuit.offset)
    return np.array(offsets[len(offsets) * 2 // 3:]), pursuit


def test_pursuit_comes_back_to_a_straight():
    offsets, _ = follow(Path([(30.0, 0.0)], closed=False), 0.0, 0.4, 0.3)
    assert np.abs(offsets).max() < 1e-3


@pytest.mark.parametrize("sign", [1, -1])
def test_pursuit_holds_a_circle_to_either_side(sign):
    circle = Path([(2 * pi * 1.2, sign / 1.2)], closed=True)
    offsets, pursuit = follow(circle, 0.0, 0.0, 0.0)
    assert np.abs(offsets).max() < 0.02
    assert pursuit.s > circle.length


def test_on_the_circle_the_angle_is_ackermanns():
    circle = Path([(2 * pi * 1.2, 1 / 1.2)], closed=True)
    angle = PurePursuit(circle, WHEELBASE, delay=0.0).steer(Pose(0.0, 0.0, 0.0), 0.0, 0.0)
    assert angle == pytest.approx(atan(WHEELBASE / 1.2), rel=0.02)


def test_pursuit_follows_the_eight():
    offsets, pursuit = follow(figure_of_eight(0.9), 0.0, 0.0, 0.0, seconds=40.0)
    assert np.abs(offsets).max() < 0.06
    assert pursuit.s > pursuit.path.length
