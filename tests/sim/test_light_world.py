"""Several light cars in one place: outlines that touch, walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.flat import with_values
from dart_lab.sim.light import Area, LightWorld, Outline, WorldConfig
from dart_lab.sim.light.world import corners, overlaps

OUTLINE = Outline()
POSE = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-4.0, 4.0))


def any_point_of_a_in_b(a, b, outline):
    """By brute force: a grid of points of one rectangle, in the frame of the other."""
    u = outline.ahead + outline.length * np.linspace(-0.5, 0.5, 61)[:, None]
    v = outline.width * np.linspace(-0.5, 0.5, 41)[None, :]
    x = a[0] + u * math.cos(a[2]) - v * math.sin(a[2]) - b[0]
    y = a[1] + u * math.sin(a[2]) + v * math.cos(a[2]) - b[1]
    along = x * math.cos(b[2]) + y * math.sin(b[2]) - outline.ahead
    left = y * math.cos(b[2]) - x * math.sin(b[2])
    return bool(((np.abs(along) <= 0.5 * outline.length)
                 & (np.abs(left) <= 0.5 * outline.width)).any())


@given(POSE, POSE)
def test_overlap_is_a_common_point(a, b):
    poses = np.array([a, b])
    found = any_point_of_a_in_b(a, b, OUTLINE) or any_point_of_a_in_b(b, a, OUTLINE)
    small = Outline(0.95 * OUTLINE.length, 0.95 * OUTLINE.width, OUTLINE.ahead)
    if found:
        assert overlaps(corners(poses, OUTLINE))[0, 1]
    if overlaps(corners(poses, small))[0, 1]:
        assert found


def test_corners_at_an_angle_need_the_sides_of_both():
    """Two crossed cars with no corner inside the other; and two that only nearly touch."""
    mid = OUTLINE.ahead
    crossed = np.array([[-mid, 0.0, 0.0], [0.0, -mid, math.pi / 2]])
    assert overlaps(corners(crossed, Outline(0.4, 0.1)))[0, 1]
    poses = np.array([[0.0, 0.0, 0.0], [0.28, 0.28, math.pi / 4]])
    assert not overlaps(corners(poses, OUTLINE)).any()


@pytest.mark.slow
def test_cars_meet_and_leave():
    world = LightWorld(["upstream-2024"] * 3, [[0, 0, 0], [3, 0, math.pi], [0, 2, 0]])
    assert not world.contacts().any()
    contacts = []
    for _ in range(500):
        world.advance(np.full(3, 0.3), np.zeros(3))
        contacts.append(world.contacts()[0, 1])
        assert not world.contacts()[2].any()
    first, last = contacts.index(True), len(contacts) - contacts[::-1].index(True)
    assert 50 < first < last < 450
    assert world.contacts().tolist() == world.contacts().T.tolist()


def test_poses_are_those_of_the_rear_axle():
    poses = [[1.0, 2.0, 0.5], [-1.0, 0.0, 2.5]]
    world = LightWorld(["paper", with_values(PAPER, {"body.mass": 1.8})], poses)
    np.testing.assert_allclose(world.poses, poses)
    assert world.state[0][0] > 1.05, "the state is that of the centre of mass"


def test_a_car_that_leaves_the_floor():
    config = WorldConfig(area=Area(-1.0, 2.0, -1.0, 1.0))
    world = LightWorld(["upstream-2024"] * 2, [[0, 0, 0], [0, 0.5, 0]], config)
    assert not world.outside().any()
    for _ in range(300):
        world.advance(np.array([0.3, 0.0]), np.zeros(2))
    assert world.outside().tolist() == [True, False]
    assert not LightWorld(["paper"], [[9, 9, 9]]).outside().any()


def test_refusals():
    with pytest.raises(UsageError):
        LightWorld(["paper"] * 2, [[0, 0, 0]])
    with pytest.raises(ConfigError):
        Area(1.0, 0.0, 0.0, 1.0)
