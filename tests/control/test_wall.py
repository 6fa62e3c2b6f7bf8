"""A way along a wall out of the points of one scan: corners, boxes, glass."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.control import wall as wall_module
from dart_hal.control.wall import BOX_ANGLE, MIN_CLEARANCE, Wall
from dart_hal.core.types import Pose
from dart_hal.estimation.localisation.rays import NO_HIT, cast_numpy

BEAMS = 300


def scan(*walls, glass=()):
    """Points (n, 2) that a lidar at 0, 0 sees of walls x1, y1, x2, y2; NaN: nothing, or glass."""
    turn = 2.0 * np.pi / BEAMS * np.arange(BEAMS)
    way = np.column_stack((np.cos(turn), np.sin(turn)))
    r = cast_numpy(np.array(walls), np.zeros((BEAMS, 2)), way)
    r[r == NO_HIT] = np.nan
    if glass:
        r[cast_numpy(np.array((glass,)), np.zeros((BEAMS, 2)), way) < NO_HIT] = np.nan
    return r[:, None] * way


def clear(way, *walls):
    """Least distance [m] of a way from walls."""
    lines = np.array(walls)
    off = []
    for a, b in zip(lines[:, :2], lines[:, 2:], strict=True):
        u = np.clip((way - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        off.append(np.hypot(*(way - a - u[:, None] * (b - a)).T).min())
    return min(off)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("off", [0.35, 0.6, 0.9])
def test_it_goes_along_the_wall_at_the_requested_gap(side, off):
    way = Wall(side, 0.6)(scan((-4.0, side * off, 4.0, side * off)), Pose()).middle
    assert way[-1, 0] > 1.6
    assert abs(abs(way[-1, 1] - side * off) - 0.6) < 0.05 + 0.3 * abs(off - 0.6)


def test_before_a_wall_it_turns_away_and_at_an_opening_it_turns_after_the_wall():
    right = (-3.0, -0.6, 1.6, -0.6)
    inner = scan(right, (1.6, -0.6, 1.6, 4.0))
    way = Wall()(inner, Pose()).middle
    assert way[-1, 1] > 0.5
    assert clear(way, right, (1.6, -0.6, 1.6, 4.0)) > MIN_CLEARANCE
    outer = scan((-3.0, -0.6, 0.6, -0.6), (0.6, -0.6, 0.6, -4.0), (-3.0, 3.0, 4.0, 3.0))
    assert Wall()(outer, Pose()).middle[-1, 1] < -0.2


def test_a_dead_end_is_blocked_before_it_is_touched():
    pocket = ((-2.0, -0.35, 0.9, -0.35), (-2.0, 0.35, 0.9, 0.35), (0.9, -0.35, 0.9, 0.35))
    way = Wall()(scan(*pocket), Pose()).middle
    assert len(way) < 8
    assert clear(way, *pocket) > MIN_CLEARANCE


def test_glass_between_walls_is_a_wall(monkeypatch):
    """The negative control: beams that do not come back are nothing."""
    ahead = (1.4, -1.5, 1.4, 1.5)
    sides = ((-3.0, -1.5, 1.4, -1.5), (-3.0, 1.5, 1.4, 1.5))
    points = scan(ahead, *sides, glass=(1.4, -0.8, 1.4, 0.8))
    assert Wall(gap=1.5)(points, Pose()).middle[:, 0].max() < 1.4 - MIN_CLEARANCE
    monkeypatch.setattr(wall_module, "MIN_GLASS_BEAMS", BEAMS)
    assert Wall(gap=1.5)(points, Pose()).middle[:, 0].max() > 1.4


def test_without_measurements_there_is_no_way():
    assert not Wall()(np.full((BEAMS, 2), np.nan), Pose()).is_complete


@pytest.mark.parametrize("sense", [1, -1])
def test_a_box_that_is_gone_around_is_left_and_a_room_is_not(sense):
    """Turning towards the wall on the right, clockwise, for more than a turn: a box."""
    wall = Wall(-1)
    yaw = 0.0
    while abs(yaw) < BOX_ANGLE + 0.5:
        yaw -= 0.2 * sense
        follows = wall._has_wall(Pose(0.0, 0.0, yaw))
    assert follows is (sense < 0)
    assert wall._has_wall(Pose(2.0, 0.0, yaw))
