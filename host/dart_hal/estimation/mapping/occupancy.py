"""Occupancy grid of a survey: log odds by the number of beams that ended in a cell and passed it.

    log odds  =  HIT_ODDS * hits + MISS_ODDS * misses         (Moravec and Elfes, ICRA 1985)

What moved is passed more often than hit, and disappears. Noise spreads a wall over three cells;
cells that are not the most hit across the wall are removed and become unknown.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from dart_hal.core.errors import UsageError
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.estimation.mapping.graph import compose_pose
from dart_hal.estimation.mapping.keyframes import Survey, transform_points

# m: a wall is in its cell, within 1 cm.
DEFAULT_CELL = 0.02
# Log odds of one beam, kept small because neighbours share their errors.
HIT_ODDS = float(np.log(0.7 / 0.3))
MISS_ODDS = float(np.log(0.4 / 0.6))
# Limits of occupied and free cells: the thresholds of map_server.
OCCUPIED_ODDS = float(np.log(0.65 / 0.35))
FREE_ODDS = float(np.log(0.196 / 0.804))
# m before its end in which a beam does not clear cells: there it is within the noise of the wall.
BEAM_END = 0.10
# m, sigma by which the hits are smoothed before their maximum is searched.
HIT_SMOOTHING = 0.02
# m around a cell whose hits determine the direction of a wall: 4 sigma of a distance.
WALL_WINDOW = 0.06
# Cells to either side that are compared in the search of the maximum.
THINNING_CELLS = 2
# Cells: 1600 m2.
MAX_GRID_CELLS = 4_000_000


def grid_of(survey: Survey, cell: float = DEFAULT_CELL) -> Grid:
    """Return the grid of a survey, cells [m], in its frame. Raises UsageError: too many cells."""
    views = [(view, compose_pose(pose, view.at)) for frame, pose in
             zip(survey.frames, survey.poses, strict=True) for view in frame.views]
    ends = [transform_points(view.points, pose) for view, pose in views]
    begins = [transform_points(view.origin, pose) for view, pose in views]
    low, (columns, rows) = _grid_extent(begins + ends, cell)
    hits = np.zeros(rows * columns)
    misses = np.zeros(rows * columns)

    def count(cells: FloatArray, positions: FloatArray) -> None:
        column, row = ((positions - low) / cell).astype(int).T
        cells += np.bincount(row * columns + column, minlength=rows * columns)

    for begin, end in zip(begins, ends, strict=True):
        count(hits, end)
        count(misses, list_passed(begin, end, cell))
    odds = log_odds(hits, misses).reshape(rows, columns)
    wall = thin_walls(hits.reshape(rows, columns), cell) & (odds > OCCUPIED_ODDS)
    return Grid(wall, odds < FREE_ODDS, cell, low)


def log_odds(hits: FloatArray, misses: FloatArray) -> FloatArray:
    """Log odds of being occupied, 0 = unknown, of cells with these hits and misses."""
    odds: FloatArray = HIT_ODDS * hits + MISS_ODDS * misses
    return odds


def list_passed(origin: FloatArray, end: FloatArray, cell: float) -> FloatArray:
    """Return places (k, 2) [m], one per cell, that beams from origin to end (n, 2) [m] passed."""
    length = np.hypot(*(end - origin).T)
    steps = np.maximum((length - BEAM_END) / cell, 0.0).astype(int)
    beam = np.repeat(np.arange(len(steps)), steps)
    nth = np.arange(len(beam)) - np.repeat(np.cumsum(steps) - steps, steps)
    along = (end - origin) / np.maximum(length, cell)[:, None] * cell
    places: FloatArray = origin[beam] + (nth + 0.5)[:, None] * along[beam]
    return places


def thin_walls(hits: FloatArray, cell: float) -> BoolArray:
    """Select the cells (rows, columns) that are the most hit across their wall."""
    smooth = gaussian_filter(hits, HIT_SMOOTHING / cell, mode="constant")
    across = _wall_normal(hits, WALL_WINDOW / cell)
    largest: BoolArray = hits > 0.0
    for k, (i, j) in enumerate(((1, 0), (1, 1), (0, 1), (-1, 1))):
        matching = across == k
        for n in range(1, THINNING_CELLS + 1):
            largest &= ~matching | (smooth >= _shift(smooth, n * i, n * j))
            largest &= ~matching | (smooth > _shift(smooth, -n * i, -n * j))
    return largest


def _wall_normal(hits: FloatArray, sigma: float) -> FloatArray:
    """Direction across the wall, in eighths of a turn: 0 = x, 1 = x and y, 2 = y, 3 = y - x.

    By the second moments of the hits in a Gaussian window. They follow from its derivatives,
    because x g(x) is one; the term sigma^2 of uniform hits cancels.
    """
    def moment(x: int, y: int) -> FloatArray:
        filtered: FloatArray = gaussian_filter(hits, sigma, order=(y, x), mode="constant")
        return filtered

    n = np.maximum(moment(0, 0), 1e-12)
    x = moment(1, 0)
    y = moment(0, 1)
    xx = moment(2, 0) - x * x / n
    yy = moment(0, 2) - y * y / n
    xy = moment(1, 1) - x * y / n
    turn = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi
    eighths: FloatArray = np.round(turn / (0.25 * np.pi)) % 4
    return eighths


def _shift(cells: FloatArray, i: int, j: int) -> FloatArray:
    """Return for each cell the value i columns and j rows further; the border is empty."""
    return np.roll(cells, (-j, -i), axis=(0, 1))


def _grid_extent(places: list[FloatArray], cell: float) -> tuple[FloatArray, tuple[int, int]]:
    """Lower left corner [m] of a grid that contains all places; its columns and rows."""
    low = np.min([p.min(axis=0) for p in places], axis=0) - (THINNING_CELLS + 1) * cell
    high = np.max([p.max(axis=0) for p in places], axis=0) + (THINNING_CELLS + 1) * cell
    low = cell * np.floor(low / cell)
    columns, rows = np.ceil((high - low) / cell).astype(int).tolist()
    if columns * rows > MAX_GRID_CELLS:
        raise UsageError("the map is too large", found=f"{columns} x {rows} cells",
                         expected=f"at most {MAX_GRID_CELLS}", remedy="--cell 0.05")
    return low, (columns, rows)
