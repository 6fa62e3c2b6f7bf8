"""The middle of a lane out of points, and what is learnt of wheels and lidar between two scans."""

from __future__ import annotations

from math import cos, sin

import numpy as np
import pytest

from dart_hal.control.lane import LOOK_DISTANCE, LaneView, find_lane
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.lane_model import LaneReckoning
from dart_hal.control.paths import Path
from dart_hal.core.types import Pose, Scan
from dart_hal.vehicle.sets import UPSTREAM_2024
from dart_lab.sim.lidar.lanes import LANE_HALF_WIDTH, LANE_PATHS, lane_boards
from studies.control.light_follow import plant_by

RNG = np.random.default_rng(5)


def points_of(path, pose, noise=0.015, keep=(0, 1)):
    """Points that a lidar 0.13 m before a pose sees of the boards: one each 0.57 deg."""
    both = lane_boards(path)
    c = cos(pose.yaw)
    s = sin(pose.yaw)
    axis = np.array((pose.x + 0.13 * c, pose.y + 0.13 * s))
    fine = []
    for side in keep:
        n = len(both[side])
        fine.append(np.column_stack([np.interp(np.linspace(0, n - 1, 60 * n), np.arange(n), column)
                                     for column in both[side].T]) - axis)
    if not fine:
        return np.array([(np.nan, np.nan)])
    all_ = np.vstack(fine)
    reach = np.hypot(*all_.T)
    turn = np.round(np.arctan2(*all_.T[::-1]) / 0.01).astype(int)
    order = np.argsort(reach)
    first = order[np.unique(turn[order], return_index=True)[1]]
    far = (reach[first] + noise * RNG.normal(size=len(first)))[:, None]
    way = 0.01 * turn[first]
    hit = axis + far * np.column_stack((np.cos(way), np.sin(way)))
    return np.vstack([hit, [(np.nan, np.nan)]])


def pose_off_path(path, s, left=0.0, turned=0.0):
    spot = path.interpolate(s)
    return Pose(spot.x - left * sin(spot.heading), spot.y + left * cos(spot.heading),
                spot.heading + turned)


def simulate_boards(path, pose, keep=(0, 1)):
    return find_lane(points_of(path, pose, keep=keep), pose)


def off(path, points, s):
    found = []
    for x, y in points:
        s = path.closest(x, y, s)
        found.append(path.offset(x, y, s))
    return np.array(found)


@pytest.mark.parametrize(("left", "turned"), [(0.0, 0.0), (0.1, -0.3), (-0.2, 0.5)])
@pytest.mark.parametrize("name", list(LANE_PATHS))
def test_the_middle_is_found_from_anywhere_in_the_lane(name, left, turned):
    path = LANE_PATHS[name]()
    for s in (0.5, 3.0, 4.5, 7.0, 8.5):
        marks = simulate_boards(path, pose_off_path(path, s, left, turned))
        assert marks.half == pytest.approx(LANE_HALF_WIDTH, abs=0.01)
        assert len(marks.middle) * 0.1 > 1.5
        assert np.abs(off(path, marks.middle[:11], s)).max() < 0.012


@pytest.mark.parametrize(("keep", "left", "right"), [
    ((0,), True, False), ((1,), False, True), ((), False, False)])
def test_half_a_lane_is_none(keep, left, right):
    path = LANE_PATHS["lane"]()
    marks = simulate_boards(path, pose_off_path(path, 3.0), keep)
    assert (marks.left, marks.right, marks.is_complete) == (left, right, False)


def test_it_ends_where_the_boards_end():
    path = LANE_PATHS["lane"]()
    for left in (1.5, 0.8):
        marks = simulate_boards(path, pose_off_path(path, path.length - left))
        assert path.length - 0.15 < marks.middle[-1, 0] < path.length + 0.08
    assert simulate_boards(path, pose_off_path(path, 3.0)).middle[-1, 0] < 3.0 + LOOK_DISTANCE + 0.1


def straight(left, heading):
    """A lane in the frame of a car: its middle begins ``left`` m to its left."""
    at = np.linspace(0.0, 2.0, 21)
    return Path.through(np.column_stack((at, left + at * np.tan(heading))), closed=False)


@pytest.mark.parametrize(("trim", "mount"), [(0.02, 0.0), (0.0, 0.02), (-0.015, 0.01)])
@pytest.mark.slow
def test_trim_and_mount_are_learnt_from_lanes_that_do_not_lie_where_they_lay(trim, mount):
    """A car that turns by its trim, whose lidar looks to the left by its mount, in a straight lane;
    what it learns is what is there, once it has driven 6 m."""
    p = UPSTREAM_2024
    model = LaneReckoning(plant_by(p))
    before = None
    true = np.zeros(3)
    for k in range(600):
        pose = model.advance(0.01 * k, 1.0).pose
        model.record_command(-0.5 * (true[1] + 2.0 * true[2]) - model.trim)
        angle = trim - 0.5 * (true[1] + 2.0 * true[2]) - model.trim
        true[2] += 0.01 * model._plant.steady.curvature(angle, 1.0)
        true[:2] += 0.01 * cos(true[2]), 0.01 * sin(true[2])
        if k % 13 == 12:
            left = -true[1] / cos(true[2])
            heading = -true[2] - mount + model.mount
            lane = straight(left, heading).moved(
                pose.x - left * sin(pose.yaw), pose.y + left * cos(pose.yaw), pose.yaw + heading)
            if before is not None:
                model.compare(before, lane)
            before = lane
    assert model.trim == pytest.approx(trim, abs=0.005)
    assert model.mount == pytest.approx(mount, abs=0.005)


@pytest.mark.parametrize(("offset", "ended"), [(0.1, ""), (0.29, ""),
                                               (0.31, "the car left the lane")])
def test_outside_the_lane_a_drive_ends_and_is_no_success(offset, ended):
    middle = np.column_stack((np.arange(0.0, 3.0, 0.1), np.full(30, offset)))
    follower = LaneFollower(plant_by(UPSTREAM_2024), 1.0,
                            find_lane=lambda points, pose: LaneView(middle, 0.4, True, True))
    scan = Scan(0.0, 0.0, 7.0, np.zeros(1), np.zeros(1), np.ones(1))
    follower.answer(0.0, 0.0)
    follower.answer(0.1, 0.0, [scan])
    follower.answer(0.11, 0.0)
    assert follower.why.startswith(ended)
    assert bool(follower.why) == bool(ended)
    assert not follower.good


@pytest.mark.parametrize(("cap", "commanded"), [(0.0, 0.0), (0.1, 0.0), (0.2, 0.2)])
def test_a_cap_below_the_slowest_speed_makes_the_car_wait(cap, commanded):
    """No motor turns so slowly: 0.2 m/s would exceed the limit."""
    middle = np.column_stack((np.arange(0.0, 3.0, 0.1), np.zeros(30)))
    follower = LaneFollower(plant_by(UPSTREAM_2024), cap,
                            find_lane=lambda points, pose: LaneView(middle, 0.4, True, True))
    scan = Scan(0.0, 0.0, 7.0, np.zeros(1), np.zeros(1), np.ones(1))
    follower.answer(0.0, 0.0)
    for k in range(1, 20):
        command = follower.answer(0.1 * k, 0.0, [scan])
    assert command.speed == pytest.approx(commanded)
    assert not follower.why
