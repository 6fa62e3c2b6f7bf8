"""The occupancy grid of a survey: how often beams ended in a cell and passed it, by log odds.

    log odds  =  HIT * hits + MISS * misses         (Moravec and Elfes, ICRA 1985)

What moved is passed more often than hit, and is gone. Noise spreads a wall over three cells; those
that are not the most hit across the wall are taken out, and are unknown.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from dart_hal.core.errors import UsageError
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.estimation.mapping.graph import onto
from dart_hal.estimation.mapping.keyframes import Survey, placed

CELL = 0.02
"""m: a wall is where its cell is, to 1 cm."""
HIT, MISS = float(np.log(0.7 / 0.3)), float(np.log(0.4 / 0.6))
"""Of one beam: neighbours share their errors, so that one tells little."""
OCCUPIED, FREE = float(np.log(0.65 / 0.35)), float(np.log(0.196 / 0.804))
"""Beyond which a cell is one: the thresholds of map_server."""
SHORT = 0.10
"""m before its end from which on a beam passes nothing: beside a wall it runs in its noise."""
SMOOTH = 0.02
"""m: of the hits before the most of them is looked for."""
WINDOW = 0.06
"""m around a cell whose hits tell how a wall runs: 4 sigma of a distance."""
AROUND = 2
"""Cells to either side among which one of a wall is the most hit."""
MOST = 4_000_000
"""Cells: 1600 m2."""


def grid_of(survey: Survey, cell: float = CELL) -> Grid:
    """The grid of a survey, with cells [m], in its frame. Raises UsageError: too many cells."""
    views = [(view, onto(pose, view.at)) for frame, pose in
             zip(survey.frames, survey.poses, strict=True) for view in frame.views]
    ends = [placed(view.points, pose) for view, pose in views]
    begins = [placed(view.origin, pose) for view, pose in views]
    low, (columns, rows) = _frame(begins + ends, cell)
    hits, misses = np.zeros(rows * columns), np.zeros(rows * columns)

    def count(cells: FloatArray, at: FloatArray) -> None:
        column, row = ((at - low) / cell).astype(int).T
        cells += np.bincount(row * columns + column, minlength=rows * columns)

    for begin, end in zip(begins, ends, strict=True):
        count(hits, end)
        count(misses, passed(begin, end, cell))
    odds = log_odds(hits, misses).reshape(rows, columns)
    wall = thinned(hits.reshape(rows, columns), cell) & (odds > OCCUPIED)
    return Grid(wall, odds < FREE, cell, low)


def log_odds(hits: FloatArray, misses: FloatArray) -> FloatArray:
    """Of being occupied, 0 = unknown, of cells with so many hits and misses."""
    odds: FloatArray = HIT * hits + MISS * misses
    return odds


def passed(origin: FloatArray, end: FloatArray, cell: float) -> FloatArray:
    """Places (k, 2) [m], a cell apart, that the beams from origin to end (n, 2) [m] passed."""
    length = np.hypot(*(end - origin).T)
    steps = np.maximum((length - SHORT) / cell, 0.0).astype(int)
    beam = np.repeat(np.arange(len(steps)), steps)
    nth = np.arange(len(beam)) - np.repeat(np.cumsum(steps) - steps, steps)
    along = (end - origin) / np.maximum(length, cell)[:, None] * cell
    places: FloatArray = origin[beam] + (nth + 0.5)[:, None] * along[beam]
    return places


def thinned(hits: FloatArray, cell: float) -> BoolArray:
    """Cells (rows, columns) that are the most hit across the wall that they are of."""
    smooth = gaussian_filter(hits, SMOOTH / cell, mode="constant")
    across = _across(hits, WINDOW / cell)
    most: BoolArray = hits > 0.0
    for k, (i, j) in enumerate(((1, 0), (1, 1), (0, 1), (-1, 1))):
        here = across == k
        for n in range(1, AROUND + 1):
            most &= ~here | (smooth >= _moved(smooth, n * i, n * j))
            most &= ~here | (smooth > _moved(smooth, -n * i, -n * j))
    return most


def _across(hits: FloatArray, sigma: float) -> FloatArray:
    """Direction across the wall, in eighths of a turn: 0 = x, 1 = x and y, 2 = y, 3 = y less x.

    By the second moments of the hits around; those of a Gaussian window are sigma^2 where hits
    are everywhere, and come out of it alone: x g(x) is its derivative."""
    def moment(x: int, y: int) -> FloatArray:
        told: FloatArray = gaussian_filter(hits, sigma, order=(y, x), mode="constant")
        return told

    n, x, y = (np.maximum(moment(0, 0), 1e-12), moment(1, 0), moment(0, 1))
    xx, yy, xy = moment(2, 0) - x * x / n, moment(0, 2) - y * y / n, moment(1, 1) - x * y / n
    turn = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi
    eighths: FloatArray = np.round(turn / (0.25 * np.pi)) % 4
    return eighths


def _moved(cells: FloatArray, i: int, j: int) -> FloatArray:
    """To each cell what is i columns and j rows on; there is nothing at the border."""
    return np.roll(cells, (-j, -i), axis=(0, 1))


def _frame(places: list[FloatArray], cell: float) -> tuple[FloatArray, tuple[int, int]]:
    """Lower left corner [m] of a grid that holds all places; its columns and rows."""
    low = np.min([p.min(axis=0) for p in places], axis=0) - (AROUND + 1) * cell
    high = np.max([p.max(axis=0) for p in places], axis=0) + (AROUND + 1) * cell
    low = cell * np.floor(low / cell)
    columns, rows = np.ceil((high - low) / cell).astype(int).tolist()
    if columns * rows > MOST:
        raise UsageError("the map is too large", found=f"{columns} x {rows} cells",
                         expected=f"at most {MOST}", remedy="--cell 0.05")
    return low, (columns, rows)
