"""Distances from points along rays to the first line: exact, in NumPy or C (``rays.c``).

A ray does not meet a line that is parallel to it, or one on which it starts.

``cast``: every ray against every line, for few lines or for lines that move. ``LineIndex``: for the
lines of a map. A grid lists the lines of each cell, and the size of the empty square around each
empty cell. A ray visits the cells on its path and skips empty squares, so that its cost hardly
depends on the number of lines.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.estimation.localisation.native import load_function

# m: distance of a ray that meets no line.
NO_HIT = 1e9
# Share of a line by which it is extended at both ends, so that no ray passes a corner.
LINE_EXTENSION = 1e-9
# m: shortest distance of a hit, above the rounding of a start on a line.
MIN_HIT_DISTANCE = 1e-9
# m: length of a line across a ray below which both are parallel; larger than its rounding.
MIN_LENGTH_ACROSS = 1e-12
# Pairs of ray and line per block of NumPy: three arrays of 1.6 MB.
MAX_PAIRS = 200_000

# m: side of the cells of a grid. Outlines of a map of 2 cm have some five lines in one.
CELL_SIDE = 0.1
# Cells of a grid, 2 MB; larger maps have larger cells.
MAX_GRID_CELLS = 250_000
# Largest empty square, which a byte holds.
MAX_JUMP = 255
# Lines of a block, which ``rays.c`` tries at once.
BLOCK = 4
# m by which a line reaches into neighbouring cells: more than the rounding of a ray's position.
CELL_OVERLAP = 1e-6
# Lines from which on the grid is quicker than all pairs in NumPy.
MIN_LINES_OF_GRID = 250
# Cells along each axis that NumPy visits at once.
CELLS_PER_ROUND = 24

Cast = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""``cast(lines, origin, direction)``: lines (m, 4) as x1, y1, x2, y2 [m], origin (n, 2) [m],
direction (n, 2) of length 1; the distance (n,) [m] to the first line, ``NO_HIT`` without one."""


def cast_numpy(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Implement ``Cast`` in NumPy, block by block of rays."""
    out = np.full(len(origin), NO_HIT)
    if len(lines):
        some = max(MAX_PAIRS // len(lines), 1)
        for k in range(0, len(origin), some):
            out[k:k + some] = _cast_block(lines, origin[k:k + some], direction[k:k + some])
    return out


def _cast_block(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Solve a + u e = o + t d by Cramer's rule; its determinants are matrix products."""
    ax, ay, bx, by = lines.T
    ex = bx - ax
    ey = by - ay
    one = np.ones(len(origin))
    (ox, oy) = origin.T
    (dx, dy) = direction.T
    den = direction @ np.array((ey, -ex))
    t = np.column_stack((ox, oy, one)) @ np.array((-ey, ex, ax * ey - ay * ex))
    u = np.column_stack((dy, -dx, ox * dy - oy * dx)) @ np.array((ax, ay, -np.ones(len(ax))))
    nearest: FloatArray = np.minimum(_distances(den, t, u).min(axis=1), NO_HIT)
    return nearest


def _distances(den: FloatArray, t: FloatArray, u: FloatArray) -> FloatArray:
    """Return the distances of the hits, NO_HIT for others; den, t, u: determinants, changed."""
    den[np.abs(den) < MIN_LENGTH_ACROSS] = 1e-300
    with np.errstate(over="ignore"):
        t /= den
        u /= den
    u -= 0.5
    np.abs(u, out=u)
    misses = u > 0.5 + LINE_EXTENSION
    misses |= t <= MIN_HIT_DISTANCE
    np.putmask(t, misses, NO_HIT)
    return t


@dataclass(frozen=True, eq=False)
class LineGrid:
    """Lines by the cells of a grid.

    low (2,) [m]: corner of cell 0, 0; side [m]; blocks (b, 4, 4): x1, y1 and extent along x and y
    [m] of four lines, zeros where there are fewer; first (rows * columns + 1,): number of the first
    block of each cell, row by row. jump (4, rows, columns): columns and rows of the largest empty
    square that begins at a cell and extends towards +x +y, -x +y, +x -y, -x -y; 0: it has lines.
    """

    low: FloatArray
    side: float
    first: NDArray[np.int32]
    jump: NDArray[np.uint8]
    blocks: FloatArray

    @cached_property
    def c_struct(self) -> _Grid:
        """Return the grid for ``rays.c``."""
        _, rows, columns = self.jump.shape
        return _Grid(*self.low, self.side, rows, columns, _address(self.jump),
                     _address(self.first), _address(self.blocks))


class LineIndex:
    """Lines (m, 4) of a map, prepared for many rays when the first one is cast."""

    def __init__(self, lines: FloatArray) -> None:
        self.lines = lines

    @cached_property
    def grid(self) -> LineGrid:
        """Return the lines by cells."""
        return make_grid(self.lines)

    def cast(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the distances (n,) [m] of rays, as ``Cast`` does."""
        if not len(self.lines):
            return np.full(len(origin), NO_HIT)
        compiled = native_grid_cast()
        if compiled is not None:
            return compiled(self.grid, origin, direction)
        if len(self.lines) < MIN_LINES_OF_GRID:
            return cast_numpy(self.lines, origin, direction)
        return cast_grid_numpy(self.grid, origin, direction)


def make_grid(lines: FloatArray) -> LineGrid:
    """Return the grid of at least one line."""
    # 1. All cells that each line touches.
    ends = lines.reshape(-1, 2)
    low = ends.min(axis=0) - 2.0 * CELL_OVERLAP
    width, height = (ends.max(axis=0) - low + 2.0 * CELL_OVERLAP).tolist()
    side = max(CELL_SIDE, (width * height / MAX_GRID_CELLS)**0.5, width / MAX_GRID_CELLS,
               height / MAX_GRID_CELLS)
    columns = int(width / side) + 1
    rows = int(height / side) + 1
    which, row, column = _list_touched(lines - np.tile(low, 2), side)
    index = row * columns + column
    # 2. Blocks of lines, cell by cell.
    order = np.argsort(index, kind="stable")
    count = np.bincount(index, minlength=rows * columns)
    first = np.append(0, np.cumsum(-(-count // BLOCK))).astype(np.int32)
    nth = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    blocks = np.zeros((int(first[-1]), 4, BLOCK))
    blocks[first[index[order]] + nth // BLOCK, :, nth % BLOCK] = np.hstack(
        (lines[:, :2], lines[:, 2:] - lines[:, :2]))[which[order]]
    # 3. Empty squares from each cell on.
    empty = (count == 0).reshape(rows, columns)
    jump = np.stack([_empty_squares(empty[::sy, ::sx])[::sy, ::sx] for sy in (1, -1)
                     for sx in (1, -1)])
    return LineGrid(low, side, first, jump, blocks)


def _empty_squares(empty: BoolArray) -> NDArray[np.uint8]:
    """Return the size of the largest empty square with its first row and column at each cell.

    A square of size k + 1 consists of four squares of size k; cells beyond the grid are empty.
    """
    square = empty.copy()
    size: NDArray[np.uint8] = square.astype(np.uint8)
    for _ in range(1, min(MAX_JUMP, max(empty.shape))):
        square[:-1] &= square[1:]
        square[:, :-1] &= square[:, 1:]
        size += square
    return size


def _list_touched(lines: FloatArray, side: float) -> tuple[IntArray, IntArray, IntArray]:
    """Return number of the line, row and column of each cell [m] that lines (m, 4) [m] touch."""
    # 1. Columns of the line, from its left end to its right one.
    x1, y1, x2, y2 = np.where((lines[:, 0] <= lines[:, 2])[:, None], lines,
                              lines[:, [2, 3, 0, 1]]).T
    which, column = _count_through((x1 - CELL_OVERLAP) / side, (x2 + CELL_OVERLAP) / side)
    # 2. y where it enters and leaves the column, not beyond its own ends.
    slope = (y2 - y1) / np.maximum(x2 - x1, CELL_OVERLAP)
    enter, leave = (y1[which] + slope[which] * (np.clip(side * edge + reach, x1[which], x2[which])
                                                - x1[which])
                    for edge, reach in ((column, -CELL_OVERLAP), (column + 1, CELL_OVERLAP)))
    # A line of no width has one column and its whole height.
    is_steep = (x2 - x1 < CELL_OVERLAP)[which]
    enter = np.where(is_steep, y1[which], enter)
    leave = np.where(is_steep, y2[which], leave)
    # 3. Rows in between.
    nth, row = _count_through((np.minimum(enter, leave) - CELL_OVERLAP) / side,
                              (np.maximum(enter, leave) + CELL_OVERLAP) / side)
    return which[nth], row, column[nth]


def _count_through(low: FloatArray, high: FloatArray) -> tuple[IntArray, IntArray]:
    """Return, for each pair of numbers, its index and the integers from low to high, rounded."""
    first = np.floor(low).astype(int)
    number = np.floor(high).astype(int) - first + 1
    which = np.repeat(np.arange(len(first)), number)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)
    return which, first[which] + nth


def cast_grid_numpy(grid: LineGrid, origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the distances of rays as ``Cast`` does, in NumPy, some cells of all rays at once.

    The cells of a ray are that of its start and the one behind each side of a cell that it crosses.
    """
    out = np.full(len(origin), NO_HIT)
    place = (origin - grid.low) / grid.side
    speed = direction / grid.side
    rows, columns = grid.jump.shape[1:]
    inside = _start_inside(place, speed, (columns, rows))
    # 1. The first cell.
    rays = np.flatnonzero(inside < NO_HIT)
    begin = place[rays] + inside[rays, None] * speed[rays]
    start = np.minimum(np.maximum(begin, 0.0), (columns - 0.5, rows - 0.5)).astype(int)
    _lower(out, grid, rays, start, origin, direction)
    for k in range(0, max(rows, columns), CELLS_PER_ROUND):
        # 2. Cells behind the next sides across x, then y; ``covered`` [m]: of the path.
        covered = np.full(len(rays), NO_HIT)
        for axis in (0, 1):
            crossing = k + np.arange(CELLS_PER_ROUND)
            step = np.where(speed[rays, axis] > 0.0, 1, -1)
            is_moving = np.abs(direction[rays, axis]) > MIN_LENGTH_ACROSS
            behind = start[:, axis, None] + step[:, None] * (crossing + 1)
            side = behind + (step[:, None] < 0)
            along = np.where(is_moving, speed[rays, axis], 1.0)[:, None]
            t = (side - place[rays, axis, None]) / along
            # Slightly ahead: through a corner it is the cell beyond the corner, for both axes.
            ahead = t + 0.5 * CELL_OVERLAP
            other = np.floor(place[rays, 1 - axis, None] + ahead * speed[rays, 1 - axis, None])
            size = (columns, rows)
            valid = is_moving[:, None] & (behind >= 0) & (behind < size[axis])
            valid &= (other >= 0.0) & (other < size[1 - axis])
            covered = np.where(is_moving, np.minimum(covered, t[:, -1]), covered)
            nth, which = np.nonzero(valid)
            pair = np.column_stack((behind[nth, which], other[nth, which].astype(int)))
            _lower(out, grid, rays[nth], pair[:, ::1 - 2 * axis], origin, direction)
        # 3. Rays that have met no line by then go on.
        going = out[rays] > covered
        rays = rays[going]
        start = start[going]
        if not len(rays):
            break
    return out


def _start_inside(place: FloatArray, speed: FloatArray, size: tuple[int, int]) -> FloatArray:
    """Return the distances (n,) at which rays enter the grid, NO_HIT for those that miss it."""
    enter = np.zeros(len(place))
    leave = np.full(len(place), NO_HIT)
    for axis in (0, 1):
        p = place[:, axis]
        is_moving = np.abs(speed[:, axis]) * CELL_SIDE > MIN_LENGTH_ACROSS
        v = np.where(is_moving, speed[:, axis], 1.0)
        ends = np.sort((-p / v, (size[axis] - p) / v), axis=0)
        passes = (p >= 0.0) & (p <= size[axis])
        enter = np.where(is_moving, np.maximum(enter, ends[0]), np.where(passes, enter, NO_HIT))
        leave = np.where(is_moving, np.minimum(leave, ends[1]), leave)
    return np.where(enter > leave + MIN_HIT_DISTANCE, NO_HIT, enter)


def _lower(out: FloatArray, grid: LineGrid, rays: IntArray, cells: IntArray, origin: FloatArray,
           direction: FloatArray) -> None:
    """Lower the distances ``out`` of rays to the lines of cells (k, 2), columns and rows."""
    index = cells[:, 1] * grid.jump.shape[2] + cells[:, 0]
    first = grid.first[index]
    count = grid.first[index + 1] - first
    which = np.repeat(np.arange(len(first)), count)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    ax, ay, ex, ey = grid.blocks[first[which] + nth].transpose(1, 0, 2)
    ray = rays[which]
    rx = ax - origin[ray, 0, None]
    ry = ay - origin[ray, 1, None]
    dx, dy = direction[ray].T[:, :, None]
    t = _distances(dx * ey - dy * ex, rx * ey - ry * ex, rx * dy - ry * dx)
    np.minimum.at(out, ray, t.min(axis=1))


class _Limits(ctypes.Structure):
    """Limits of a hit, as in ``rays.c``."""

    _fields_ = tuple((name, ctypes.c_double) for name in ("far", "slack", "parallel", "least"))


class _Grid(ctypes.Structure):
    """A ``LineGrid``, as in ``rays.c``."""

    _fields_ = (*((name, ctypes.c_double) for name in ("left", "low", "side")),
                *((name, ctypes.c_int64) for name in ("rows", "columns")),
                *((name, ctypes.c_void_p) for name in ("jump", "first", "block")))


LIMITS = _Limits(NO_HIT, LINE_EXTENSION, MIN_LENGTH_ACROSS, MIN_HIT_DISTANCE)
LIMITS_ADDRESS = ctypes.addressof(LIMITS)


def _address(array: NDArray[Any]) -> int:
    """Return the address of the first number; quicker than ``ctypes.data``."""
    address: int = array.__array_interface__["data"][0]
    return address


def _call(compiled: Any, origin: FloatArray, direction: FloatArray, *more: object) -> FloatArray:
    """Call a function of ``rays.c``; return its distances."""
    start = np.ascontiguousarray(origin, dtype=np.float64)
    ahead = np.ascontiguousarray(direction, dtype=np.float64)
    out = np.empty(len(start))
    compiled(len(start), _address(start), _address(ahead), _address(out), LIMITS_ADDRESS,
             *more)
    return out


@lru_cache(maxsize=1)
def native_cast() -> Cast | None:
    """Return ``Cast`` in C; None if not available, or different from NumPy."""
    compiled = _load("cast", [ctypes.c_int64, *[ctypes.c_void_p] * 4])
    if compiled is None:
        return None

    def cast(lines: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray:
        ends = np.array(lines.T, dtype=np.float64, order="C")
        ends[2:] -= ends[:2]
        return _call(compiled, origin, direction, len(lines), *[_address(c) for c in ends])

    return cast if _is_equal(cast) else None


@lru_cache(maxsize=1)
def native_grid_cast() -> Callable[[LineGrid, FloatArray, FloatArray], FloatArray] | None:
    """Return ``cast_grid_numpy`` in C; None if not available, or different from NumPy."""
    compiled = _load("cast_grid", [ctypes.c_void_p])
    if compiled is None:
        return None

    def cast(grid: LineGrid, origin: FloatArray, direction: FloatArray) -> FloatArray:
        return _call(compiled, origin, direction, ctypes.addressof(grid.c_struct))

    return cast if _is_equal(lambda lines, *rays: cast(make_grid(lines), *rays)) else None


def _load(name: str, further: list[Any]) -> Any | None:
    """Load a function of ``rays.c``; None if not available. further: types of its last arguments.
    """
    compiled = load_function(name, "rays.c")
    if compiled is not None:
        compiled.argtypes = [ctypes.c_int64, *[ctypes.c_void_p] * 4, *further]
    return compiled


def _is_equal(cast: Cast) -> bool:
    """Compare with NumPy on random rays and lines."""
    rng = np.random.default_rng(1)
    lines = rng.uniform(-5.0, 5.0, (40, 4))
    origin = rng.uniform(-5.0, 5.0, (200, 2))
    turn = rng.uniform(-np.pi, np.pi, 200)
    direction = np.column_stack((np.cos(turn), np.sin(turn)))
    return bool(np.allclose(cast(lines, origin, direction),
                            cast_numpy(lines, origin, direction), rtol=1e-12, atol=1e-12))


def fastest_cast() -> Cast:
    """Return the fastest implementation available."""
    return native_cast() or cast_numpy
