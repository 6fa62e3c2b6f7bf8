"""Log odds of what beams hit and passed, walls a cell thick, lines through noise."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.localisation.grid import Grid, read_grid, write_grid
from dart_hal.estimation.mapping.keyframes import Keyframe, ScanView, Survey
from dart_hal.estimation.mapping.occupancy import (
    FREE_ODDS,
    OCCUPIED_ODDS,
    grid_of,
    list_passed,
    log_odds,
    thin_walls,
)
from dart_hal.estimation.mapping.surfels import chart_of_points, lines_of_points


def test_log_odds_are_those_of_bayes():
    """Two hits of p 0.7 and one miss of p 0.4, by the rule of odds."""
    odds = (0.7 / 0.3)**2 * (0.4 / 0.6)
    assert log_odds(np.array(2.0), np.array(1.0)) == pytest.approx(np.log(odds))
    assert log_odds(np.array(1.0), np.array(0.0)) > OCCUPIED_ODDS
    assert log_odds(np.array(1.0), np.array(6.0)) < FREE_ODDS
    assert FREE_ODDS < log_odds(np.array(0.0), np.array(0.0)) < OCCUPIED_ODDS


def test_a_beam_passes_the_cells_before_its_end_and_not_the_last_ten_centimetres():
    x, y = list_passed(np.array(((0.0, 0.5),)), np.array(((1.0, 0.5),)), 0.02).T
    assert x == pytest.approx(0.01 + 0.02 * np.arange(45))
    assert y == pytest.approx(0.5)


@pytest.mark.parametrize("turn", [0.0, 0.5 * np.pi, 0.25 * np.pi, 0.4])
def test_a_wall_in_noise_is_thinned_to_a_cell_or_two(turn):
    rng = np.random.default_rng(1)
    along = rng.uniform(-0.8, 0.8, 8000)
    off = 0.015 * rng.normal(size=8000)
    c = np.cos(turn)
    s = np.sin(turn)
    x = c * along - s * off
    y = s * along + c * off
    hits, _, _ = np.histogram2d(y, x, bins=100, range=((-1.0, 1.0), (-1.0, 1.0)))
    thick = hits > 0.0
    thin = thin_walls(hits, 0.02)
    j, i = np.nonzero(thin)
    away = np.abs(c * (0.02 * j - 0.99) - s * (0.02 * i - 0.99))
    assert (away < 0.02).mean() > 0.98
    assert 70 < thin.sum() < 170 < thick.sum() / 2  # 1.6 m are 80 cells, on the diagonal 57


def test_what_moved_is_gone_and_what_is_fixed_stays(tmp_path):
    """A wall 2 m ahead, measured ten times; before it somebody, once. Map and file are the same."""
    y = np.linspace(-1.0, 1.0, 101)
    wall, person = (np.column_stack((np.full(101, x), y * x / 2.0)) for x in (2.01, 1.01))
    views = [ScanView(float(k), person if k == 4 else wall, wall, np.zeros((101, 2)), np.zeros(3))
             for k in range(10)]
    grid = grid_of(Survey([Keyframe(0.0, views)], np.zeros((1, 3)), [], np.zeros(0)))
    read = read_grid(write_grid(grid, tmp_path / "map.yaml").with_suffix(".yaml"))
    for there in (grid, read):
        column = np.unique(np.nonzero(there.occupied)[1])
        assert there.origin[0] + 0.02 * (column + 0.5) == pytest.approx((2.01,), abs=1e-6)
        assert there.is_free(1.01, 0.2)
        assert not there.is_free(0.5, -0.9)
    assert (read.occupied == grid.occupied).all()
    assert (read.free == (grid.free & ~grid.occupied)).all()


@pytest.mark.parametrize("name", ["room #2", "lab: east", "[a] b", "@home", "- x", "&x", "Süd"])
def test_a_map_of_any_file_name_is_read_back(tmp_path, name):
    occupied = np.eye(4, dtype=bool)
    path = tmp_path / f"{name}.yaml"
    write_grid(Grid(occupied, ~occupied, 0.05, np.zeros(2)), path)
    assert (read_grid(path).occupied == occupied).all()


def test_a_file_that_is_turned_or_short_is_not_read(tmp_path):
    grid = Grid(np.eye(3, dtype=bool), ~np.eye(3, dtype=bool), 0.05, np.array((-1.0, 2.0)))
    write_grid(grid, tmp_path / "a.yaml")
    assert read_grid(tmp_path / "a.yaml").origin == pytest.approx((-1.0, 2.0))
    assert (tmp_path / "a.pgm").read_bytes().startswith(b"P5\n3 3\n255\n")


def test_points_on_both_sides_of_a_wall_give_lines_on_it():
    rng = np.random.default_rng(2)
    points = np.column_stack((rng.uniform(0.0, 2.0, 4000), 0.5 + 0.015 * rng.normal(size=4000)))
    lines = lines_of_points(points)
    inside = (lines[:, 0] > 0.1) & (lines[:, 2] < 1.9)
    off = np.abs(lines[inside][:, (1, 3)] - 0.5).mean()
    noise = np.abs(points[:, 1] - 0.5).mean()
    assert off < 0.3 * noise
    d, _, _ = chart_of_points(points).look(np.array((1.0, 1.0)), np.array((0.8, 0.5)))
    assert d == pytest.approx((0.3, 0.0), abs=0.013)  # half a cell of the field
