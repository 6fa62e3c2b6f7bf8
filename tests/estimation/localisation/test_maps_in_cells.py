"""Maps of a few centimetres a cell: a wall is anywhere in its cell, and the covariance knows it."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import Map, map_of_grid, map_of_lines
from dart_hal.estimation.localisation.grid import (
    Grid,
    compute_wall_std,
    lines_of_grid,
    middle_lines_of_grid,
)
from dart_hal.estimation.localisation.source import LidarPoses
from dart_lab.sim.lidar.maps import box, room_of
from dart_lab.sim.room_truth import true_path
from studies.localisation.world import draw_in_cells

CELL = 0.05
# m: a wall along its cells is uniform in them, and two walls hold the car.
ALIGNED_STD = CELL / np.sqrt(24.0)


def grid_of_text(*rows):
    """Grid of 1 m cells; '#' is occupied, the last row is at the bottom."""
    occupied = np.array([[cell == "#" for cell in row] for row in rows[::-1]])
    return Grid(occupied, ~occupied, 1.0, np.zeros(2))


def test_lines_join_the_middles_of_neighbours():
    grid = grid_of_text("#....#",
                        ".....#",
                        "##..#.")
    lines = {tuple(line) for line in middle_lines_of_grid(grid).tolist()}
    assert lines == {
        (0.5, 0.5, 1.5, 0.5),  # a row of two
        (5.5, 1.5, 5.5, 2.5),  # a column of two
        (4.5, 0.5, 5.5, 1.5), (4.5, 0.5, 4.5, 0.5),  # two that touch at a corner
        (0.5, 2.5, 0.5, 2.5)}  # one alone


def test_beams_end_at_outlines_and_match_middles():
    grid = draw_in_cells(box(1.5, 1.0, 0.0, 3.0, 2.0), CELL, np.random.default_rng(0))
    chart = map_of_grid(grid)
    np.testing.assert_array_equal(chart.lines, lines_of_grid(grid))
    x, y = middle_lines_of_grid(grid)[0, :2]
    at_middle, _, _ = chart.look(np.array([x]), np.array([y]))
    at_edge, _, _ = chart.look(np.array([x]), np.array([y - 0.5 * CELL]))
    assert at_edge[0] - at_middle[0] > 0.01


@pytest.mark.parametrize("seed", range(3))
def test_walls_along_the_cells_are_uniform_in_them(seed):
    grid = draw_in_cells(box(0.0, 0.0, 0.0, 6.0, 5.0), CELL, np.random.default_rng(seed))
    assert compute_wall_std(grid) == pytest.approx(ALIGNED_STD, rel=0.03)


@pytest.mark.parametrize("angle", [0.1, 0.3, 0.7])
def test_walls_at_an_angle_average_over_their_cells(angle):
    grid = draw_in_cells(box(0.0, 0.0, angle, 6.0, 5.0), CELL, np.random.default_rng(1))
    assert compute_wall_std(grid) < 0.5 * ALIGNED_STD


def test_exact_lines_have_no_such_error():
    assert map_of_lines(box(0.0, 0.0, 0.0, 6.0, 5.0)).std == 0.0


def drive_in_cells(seed, record=None):
    """Mean normalised error squared of the estimates of a drive on a map of cells, and the last."""
    backend = open_backend(f"sim://?seed={seed}&nano=mock&lidar=1&map=room")
    lines = room_of("room", seed).lines
    source = LidarPoses(map_of_grid(draw_in_cells(lines, CELL, np.random.default_rng(seed))))
    estimates = []
    with Car.over(backend, poses=source, record=record) as car:
        for state in car.states(duration=8.0):
            if source.newest is None or source.newest.pose is None:
                continue
            if car.mode == "DISARMED":
                car.arm(waive=("CALIBRATION_MISSING",))
                continue
            car.drive_speed(steering=0.3, speed=0.8)
            estimates.append(state.external.estimate)
    estimates = estimates[50::10]
    true = true_path(backend, np.array([estimate.t for estimate in estimates]))
    off = np.array([(e.pose.x, e.pose.y) for e in estimates]) - true[:, :2]
    cov = np.array([e.pose.cov[:2, :2] for e in estimates])
    nees = np.einsum("ni,ni->n", off, np.linalg.solve(cov, off[..., None])[..., 0]) / 2.0
    return float(nees.mean()), state.external.estimate


@pytest.mark.slow
def test_the_covariance_of_the_estimate_contains_the_cells():
    assert 0.1 < np.mean([drive_in_cells(seed)[0] for seed in (3, 4, 6)]) < 3.0


@pytest.mark.slow
def test_control_without_the_cells_it_is_too_small(monkeypatch):
    monkeypatch.setattr(Map, "std", 0.0)
    assert np.mean([drive_in_cells(seed)[0] for seed in (3, 4, 6)]) > 5.0


@pytest.mark.slow
def test_a_replay_without_the_map_states_the_same_covariance(tmp_path):
    _, live = drive_in_cells(3, tmp_path / "run.mcap")
    with Car.open(f"replay://{tmp_path / 'run.mcap'}") as car:
        *_, last = car.states()
    np.testing.assert_allclose(last.external.estimate.cov, live.cov, rtol=1e-9)


def test_a_pose_in_a_map_of_thick_walls_is_less_certain():
    """With walls of 10 cm the normalised error squared was 5.8: they are anywhere in them."""
    def compute_std(thickness):
        occupied = np.zeros((200, 300), dtype=bool)
        for k in range(thickness):
            occupied[20 + k, 20:280] = occupied[180 - k, 20:280] = True
            occupied[20:181, 20 + k] = occupied[20:181, 279 - k] = True
        return compute_wall_std(Grid(occupied, ~occupied, 0.02, np.zeros(2)))

    assert compute_std(1) == compute_std(2) == pytest.approx(0.02 / np.sqrt(24.0))
    assert compute_std(5) == pytest.approx(0.02 * np.sqrt(10.0 / 24.0))
