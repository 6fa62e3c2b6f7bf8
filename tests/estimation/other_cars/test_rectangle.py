"""Rectangles by their beams: the centre behind the visible sides, at any distance and heading."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.localisation.rays import cast_numpy
from dart_hal.estimation.other_cars.rectangle import (
    CarSize,
    fit_rectangle,
    rectangle_distances,
    select_window,
)
from dart_hal.estimation.other_cars.sweep import RoomBeams
from dart_lab.sim.lidar.maps import box

SIZE = CarSize(0.30, 0.19, 0.0875)
WALL = 6.0


def body(pose, size=SIZE):
    x, y, yaw = pose
    return box(x + size.centre_x * np.cos(yaw), y + size.centre_x * np.sin(yaw), yaw, size.length,
               size.width)


def sweep_of(*bodies, noise=0.0, seed=1):
    """620 beams from the origin to bodies before a wall of 6 m around."""
    angle = np.arange(620) * 2.0 * np.pi / 620
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    origin = np.zeros_like(direction)
    reach = np.minimum(cast_numpy(np.vstack(bodies), origin, direction), WALL)
    reach = reach + noise * np.random.default_rng(seed).normal(size=len(reach))
    wall = np.full(620, WALL)
    return RoomBeams(2e-4 * np.arange(620), origin, direction, reach, wall, reach < WALL - 0.2)


def poses_around(pose, seed=2, n=800):
    return pose + np.random.default_rng(seed).normal(size=(n, 3)) * (0.05, 0.05, 0.15)


@pytest.mark.parametrize("yaw", np.arange(0.0, 6.2, 0.5))
def test_distances_are_those_of_the_four_sides(yaw):
    poses = np.array(((1.5, 0.3, yaw), (-0.7, 2.0, yaw)))
    sweep = sweep_of(body(poses[0]))
    found = rectangle_distances(poses, SIZE, sweep)
    for row, pose in zip(found, poses, strict=True):
        expected = cast_numpy(body(pose), sweep.origin, sweep.direction)
        hit = np.isfinite(row)
        assert np.allclose(row[hit], expected[hit], atol=1e-6)
        assert np.all(expected[~hit] > 100.0)


@pytest.mark.parametrize("distance", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("yaw", [0.0, 0.8, 1.57, 2.6])
def test_centre_is_behind_the_visible_sides(distance, yaw):
    """Control: the middle of the points is not the centre."""
    true = np.array((distance, 0.2, yaw))
    sweep = sweep_of(body(true), noise=0.015)
    window = select_window(sweep, np.array((distance, 0.2)), SIZE)
    fit = fit_rectangle(poses_around(true + np.array((0.02, -0.02, 0.08))), SIZE, window)
    ahead = SIZE.centre_x * np.array((np.cos(yaw), np.sin(yaw)))
    found = fit.mean[:2] + SIZE.centre_x * np.array((np.cos(fit.mean[2]), np.sin(fit.mean[2])))
    assert np.hypot(*(found - true[:2] - ahead)) < 0.03
    assert fit.share > 0.85
    assert fit.hits == fit.due or fit.hits > 5
    middle = sweep.points[sweep.unexplained].mean(axis=0)
    assert np.hypot(*(middle - true[:2] - ahead)) > 0.05


def test_two_legs_are_no_car_since_beams_pass_between_them():
    legs = [box(2.0, side * 0.16, 0.0, 0.1, 0.1) for side in (1.0, -1.0)]
    sweep = sweep_of(*legs)
    window = select_window(sweep, np.array((2.0, 0.0)), SIZE)
    side = fit_rectangle(poses_around(np.array((2.0, -SIZE.centre_x, np.pi / 2))), SIZE, window)
    assert side.share < 0.7
    whole = sweep_of(body((2.0, -SIZE.centre_x, np.pi / 2)))
    window = select_window(whole, np.array((2.0, 0.0)), SIZE)
    assert fit_rectangle(poses_around(np.array((2.0, -SIZE.centre_x, np.pi / 2))), SIZE,
                         window).share > 0.9


def test_a_car_behind_something_is_shadowed_not_contradicted():
    true = np.array((3.0, 0.0, 0.0))
    sweep = sweep_of(body(true), box(1.5, 0.0, 0.0, 0.1, 0.4))
    fit = fit_rectangle(poses_around(true), SIZE, select_window(sweep, np.array((3.0, 0.0)), SIZE))
    assert fit.shadowed
    assert fit.due == 0
    gone = sweep_of(box(-3.0, 0.0, 0.0, 0.3, 0.2))
    fit = fit_rectangle(poses_around(true), SIZE, select_window(gone, np.array((3.0, 0.0)), SIZE))
    assert not fit.shadowed
    assert fit.hits == 0


def test_beams_of_the_last_turn_are_left_out_of_a_window():
    sweep = sweep_of(body((2.0, -0.05, 0.0)))
    window = select_window(sweep, np.array((2.0, -0.05)), SIZE)
    assert np.ptp(window.t) < 0.04
    assert len(window.t) > 10
