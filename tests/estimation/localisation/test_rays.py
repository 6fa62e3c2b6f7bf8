"""The index of lines finds what all pairs of rays and lines find."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.estimation.localisation import rays
from dart_lab.sim.lidar.maps import box

RAYS_PER_CASE = 120
KINDS_OF_LINES = ("any", "level", "upright", "raster", "points", "pieces")


def draw_lines(rng, kind, size):
    """Lines of one kind, some of them without a length."""
    start = rng.uniform(-size, size, (int(rng.integers(1, 120)), 2))
    extent = rng.normal(size=start.shape) * size * 10.0**rng.uniform(-3.0, 0.3)
    if kind == "level":
        extent[:, 1] = 0.0
    if kind == "upright":
        extent[:, 0] = 0.0
    if kind == "points":
        extent[::3] = 0.0
    if kind == "pieces":
        corners = box(0.0, 0.0, float(rng.uniform(0.0, 1.0)), size, size)[:, :2]
        ends = np.vstack([a + np.linspace(0.0, 1.0, 51)[:, None] * (b - a)
                          for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
        return np.hstack((ends[:-1], ends[1:]))
    lines = np.hstack((start, start + extent))
    return 0.05 * np.round(lines / 0.05) if kind == "raster" else lines


def draw_rays(rng, lines, size):
    """Rays from anywhere and from lines; in any direction, along axes and along lines."""
    origin = rng.uniform(-1.5 * size, 1.5 * size, (RAYS_PER_CASE, 2))
    line = lines[rng.integers(0, len(lines), RAYS_PER_CASE)]
    extent = line[:, 2:] - line[:, :2]
    on_line = rng.uniform(size=RAYS_PER_CASE) < 0.2
    origin[on_line] = (line[:, :2] + rng.uniform(size=(RAYS_PER_CASE, 1)) * extent)[on_line]
    angle = rng.uniform(-np.pi, np.pi, RAYS_PER_CASE)
    angle[::4] = 0.25 * np.pi * np.round(angle[::4] / (0.25 * np.pi))
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    direction[1::8] = np.array(((1, 0), (-1, 0), (0, 1), (0, -1)))[
        rng.integers(0, 4, len(direction[1::8]))]
    length = np.hypot(*extent.T)
    along = (rng.uniform(size=RAYS_PER_CASE) < 0.15) & (length > 0.0)
    direction[along] = (extent / np.maximum(length, 1e-300)[:, None])[along]
    return origin, direction


@pytest.mark.slow
@given(seed=st.integers(0, 10**6), kind=st.sampled_from(KINDS_OF_LINES),
       size=st.sampled_from((0.3, 3.0, 30.0, 300.0)))
def test_index_finds_what_all_pairs_find(seed, kind, size):
    rng = np.random.default_rng(seed)
    lines = draw_lines(rng, kind, size)
    origin, direction = draw_rays(rng, lines, size)
    expected = rays.cast_numpy(lines, origin, direction)
    grid = rays.make_grid(lines)
    compiled = rays.native_grid_cast()
    for cast in (rays.cast_grid_numpy, *([compiled] if compiled else [])):
        assert cast(grid, origin, direction) == pytest.approx(expected, abs=1e-7 * size)


def test_missing_line_in_a_cell_is_noticed():
    """The control of the test above."""
    lines = box(0.0, 0.0, 0.3, 4.0, 3.0)
    angle = np.linspace(0.0, 6.0, 200)
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    origin = np.zeros((200, 2))
    wrong = rays.cast_grid_numpy(rays.make_grid(lines[:3]), origin, direction)
    assert wrong.max() > rays.cast_numpy(lines, origin, direction).max() + 1.0


@pytest.mark.parametrize("cast", [rays.cast_numpy, lambda lines, *ray: rays.LineIndex(lines).cast(
    *ray)])
def test_ray_passes_a_line_on_which_it_starts_or_that_is_parallel(cast):
    lines = np.array(((0.0, -1.0, 0.0, 1.0), (1.0, 0.0, 2.0, 0.0), (3.0, -1.0, 3.0, 1.0)))
    assert cast(lines, np.zeros((1, 2)), np.array(((1.0, 0.0),))) == pytest.approx([3.0])


def test_index_of_no_line_and_a_pose_that_is_no_number():
    some = np.zeros((2, 2)), np.tile((1.0, 0.0), (2, 1))
    assert (rays.LineIndex(np.empty((0, 4))).cast(*some) == rays.NO_HIT).all()
    nowhere = np.full((2, 2), np.nan)
    assert len(rays.LineIndex(box(0.0, 0.0, 0.0, 1.0, 1.0)).cast(nowhere, some[1])) == 2


def test_grid_of_a_large_map_has_a_limited_size():
    lines = np.array(((0.0, 0.0, 3000.0, 2000.0), (0.0, 2000.0, 3000.0, 0.0)))
    grid = rays.make_grid(lines)
    assert grid.jump[0].size < 1.1 * rays.MAX_GRID_CELLS
    hit = rays.LineIndex(lines).cast(np.array(((10.0, 1000.0),)), np.array(((1.0, 0.0),)))
    assert hit == pytest.approx([1490.0])
