"""Map for matching: its lines, and a raster of the distance to the nearest line.

The raster has a node every 2.5 cm and is interpolated bilinearly. It holds the unsigned distance,
because a thin wall is equal on both sides. On a straight wall it is exact, except within half a
cell of it, where the fold of the distance is flattened.

Along a wall that is oblique to the raster this flattening has ripples. The matcher would take them
for a measurement along the wall: in a bare corridor it stated millimetres and was a third of a
metre off. So where the walls around have one direction, only the gradient across it counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.boxes import select_walls
from dart_hal.estimation.localisation.grid import (
    Grid,
    compute_wall_std,
    lines_of_grid,
    middle_lines_of_grid,
)
from dart_hal.estimation.localisation.rays import LineIndex

# m between two nodes, about a third of ``matcher.C``, over which the weights change.
NODE_SPACING = 0.025
# m at which the distance is cut off: the matcher ignores more than 0.5 m.
MAX_FIELD_DISTANCE = 0.6
# m around a place, one standard deviation, whose walls determine their direction. The steps of
# cells of 5 cm need that much: with 0.1 m such a corridor was still a third of a metre off.
DIRECTION_REACH = 0.3
# Ratio of the squared gradients along and across, up to which walls have one direction, and from
# which they have none; between the two the gradient along counts in part. A right angle has 1, a
# straight wall in cells of 2 to 10 cm up to 0.08.
STRAIGHT_RATIO = 0.25
CORNER_RATIO = 0.40
# 2500 m2, 224 MB. A larger map needs a coarser raster.
MAX_NODES = 4_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Map:
    """Lines and distance field of a map. Variables of this class are named ``chart``.

    lines (m, 4): x1, y1, x2, y2 [m]; walls (k, 4): lines that remain when boxes are removed;
    origin (2,) [m] of node 0, 0; distance (rows, columns) [m], at most ``MAX_FIELD_DISTANCE``, its
    value along the border; patch (rows * columns, 7): bilinear form of the cell above and right of
    a node, the distance there and its change by x, y and x y, then the matrix (xx, xy, yy) that
    takes the part along straight walls out of a gradient; line_index, wall_index: lines and
    walls for many rays; grid: that of its file, None for a map of exact lines.
    """

    lines: FloatArray
    walls: FloatArray
    origin: FloatArray
    cell: float
    distance: FloatArray
    patch: FloatArray
    line_index: LineIndex
    wall_index: LineIndex
    grid: Grid | None = None

    @property
    def std(self) -> float:
        """Standard error [m] of a pose by the places of the walls; 0 for exact lines."""
        return 0.0 if self.grid is None else compute_wall_std(self.grid)

    def look(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return distance (n,) [m] at places (n,) [m] and its derivatives by x and y, across
        straight walls alone; constant far outside."""
        rows, columns = self.distance.shape
        u = (x - self.origin[0]) / self.cell
        v = (y - self.origin[1]) / self.cell
        for w, n in ((u, columns), (v, rows)):
            np.maximum(w, 0.0, out=w)
            np.minimum(w, n - 1.001, out=w)
        i = u.astype(np.intp)
        j = v.astype(np.intp)
        u -= i
        v -= j
        here, by_x, by_y, by_xy, xx, xy, yy = self.patch.take(j * columns + i, axis=0).T
        grow_x = by_x + by_xy * v
        grow_y = by_y + by_xy * u
        distance = here + by_x * u + grow_y * v
        return (distance, (xx * grow_x + xy * grow_y) / self.cell,
                (xy * grow_x + yy * grow_y) / self.cell)


def map_of_lines(lines: FloatArray, cell: float = NODE_SPACING) -> Map:
    """Return the map of exact lines (m, 4) [m]. Raises UsageError if none, or too large."""
    lines, low, shape = _make_raster(lines, cell)
    distance = _compute_distance(lines, low, cell, shape)
    walls = select_walls(lines, low, cell, distance)
    return Map(lines, walls, low, cell, distance, _make_patch(distance, cell), LineIndex(lines),
               LineIndex(walls))


def map_of_pieces(lines: FloatArray, cell: float = NODE_SPACING) -> Map:
    """Return the map of many lines (m, 4) [m] of at most a few cells; five times faster.

    Each node gets the distance to the piece with the nearest middle; nothing in it is a box.
    Raises as ``map_of_lines``.
    """
    from scipy.ndimage import distance_transform_edt

    lines, low, shape = _make_raster(lines, cell)
    nearest = np.full(shape, -1)
    column, row = np.round((0.5 * (lines[:, :2] + lines[:, 2:]) - low) / cell).astype(int).T
    nearest[row, column] = np.arange(len(lines))
    far, (row, column) = distance_transform_edt(nearest < 0, cell, return_indices=True)
    distance = np.full(shape, MAX_FIELD_DISTANCE)
    j, i = np.nonzero(far < MAX_FIELD_DISTANCE + 2.0 * cell)
    node = low + cell * np.column_stack((i, j))
    near = _distance(node.T, lines[nearest[row[j, i], column[j, i]]].T)
    distance[j, i] = np.minimum(near, MAX_FIELD_DISTANCE)
    index = LineIndex(lines)
    return Map(lines, lines, low, cell, distance, _make_patch(distance, cell), index, index)


def _make_raster(lines: FloatArray, cell: float) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Lines (m, 4), read-only; position of node 0, 0; rows and columns."""
    lines = np.asarray(lines, dtype=np.float64).reshape(-1, 4)
    if not len(lines):
        raise UsageError("a map without a wall", found="no line",
                         expected="walls that a lidar detects")
    ends = lines.reshape(-1, 2)
    low = ends.min(axis=0) - MAX_FIELD_DISTANCE - 2.0 * cell
    high = ends.max(axis=0) + MAX_FIELD_DISTANCE + 2.0 * cell
    columns, rows = np.ceil((high - low) / cell).astype(int) + 1
    if rows * columns > MAX_NODES:
        raise UsageError("a map too large to be matched", found=f"{columns} x {rows} nodes",
                         expected=f"at most {MAX_NODES}", remedy="cut it, or use coarser cells")
    lines.setflags(write=False)
    return lines, low, (int(rows), int(columns))


def map_of_grid(grid: Grid) -> Map:
    """Return the map of the occupied cells of a ROS grid.

    Its lines, where beams end, are the outlines of the cells; its distance is that from their
    middles. Raises as ``map_of_lines``.
    """
    chart = map_of_lines(lines_of_grid(grid), min(NODE_SPACING, grid.cell))
    distance = _compute_distance(middle_lines_of_grid(grid), chart.origin, chart.cell,
                                 chart.distance.shape)
    return replace(chart, grid=grid, distance=distance, patch=_make_patch(distance, chart.cell))


def draw_grid(chart: Map) -> Grid:
    """Return the grid of a map: that of its file, else its lines with free cells around them."""
    if chart.grid is not None:
        return chart.grid
    # A line passes within half a diagonal of the middle of a cell that it crosses.
    occupied = chart.distance <= np.sqrt(0.5) * chart.cell
    return Grid(occupied, ~occupied, chart.cell, chart.origin - 0.5 * chart.cell)


def _compute_distance(lines: FloatArray, low: FloatArray, cell: float,
                      shape: tuple[int, ...]) -> FloatArray:
    """Distance [m] of all nodes from the nearest line, at most MAX_FIELD_DISTANCE."""
    distance = np.full(shape, MAX_FIELD_DISTANCE)
    for line in lines:
        _lower_distance(distance, line, low, cell)
    return distance


def _lower_distance(distance: FloatArray, line: FloatArray, low: FloatArray, cell: float) -> None:
    """Lower ``distance`` to that from ``line``, in the box of MAX_FIELD_DISTANCE around it."""
    first = np.floor((np.minimum(line[:2], line[2:]) - MAX_FIELD_DISTANCE - low) / cell).astype(int)
    high = np.maximum(line[:2], line[2:]) + MAX_FIELD_DISTANCE
    last = np.ceil((high - low) / cell).astype(int) + 1
    box = distance[first[1]:last[1], first[0]:last[0]]
    x = low[0] + cell * np.arange(first[0], last[0])
    y = (low[1] + cell * np.arange(first[1], last[1]))[:, None]
    np.minimum(box, _distance((x, y), line), out=box)


def _distance(places: tuple[FloatArray, FloatArray] | FloatArray, line: FloatArray) -> FloatArray:
    """Distance of places x, y from lines x1, y1, x2, y2 [m], of shapes that broadcast."""
    x = places[0] - line[0]
    y = places[1] - line[1]
    ex = line[2] - line[0]
    ey = line[3] - line[1]
    along = np.clip((x * ex + y * ey) / np.maximum(ex * ex + ey * ey, 1e-12), 0.0, 1.0)
    away: FloatArray = np.hypot(x - along * ex, y - along * ey)
    return away


def _make_patch(distance: FloatArray, cell: float) -> FloatArray:
    """Return ``Map.patch``: the form of the last row and column is constant."""
    d = np.pad(distance, ((0, 1), (0, 1)), mode="edge")
    here = d[:-1, :-1]
    right = d[:-1, 1:]
    above = d[1:, :-1]
    across = d[1:, 1:]
    forms = (here, right - here, above - here, across - right - above + here)
    across_walls = _keep_across_walls(distance, cell)
    return np.ascontiguousarray(np.stack((*forms, *across_walls), axis=-1).reshape(-1, 7))


def _keep_across_walls(distance: FloatArray, cell: float) -> tuple[FloatArray, ...]:
    """Return the matrix (xx, xy, yy) at each node that keeps the gradient across straight walls.

    1. Mean products of the gradient near walls, over DIRECTION_REACH (structure tensor).
    2. Its eigenvalues: across and along the walls around. Their ratio is 0 for one straight wall.
    3. The matrix is n n' + share t t', with the directions n across and t along.
    """
    by_y, by_x = np.gradient(distance, cell)
    near = np.where(distance < DIRECTION_REACH, 1.0, 0.0)
    xx, xy, yy = (_blur(near * product, DIRECTION_REACH / cell)
                  for product in (by_x * by_x, by_x * by_y, by_y * by_y))
    spread = np.hypot(0.5 * (xx - yy), xy)
    middle = 0.5 * (xx + yy)
    ratio = (middle - spread) / np.maximum(middle + spread, 1e-9)
    share = np.clip((ratio - STRAIGHT_RATIO) / (CORNER_RATIO - STRAIGHT_RATIO), 0.0, 1.0)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    c = np.cos(angle)
    s = np.sin(angle)
    return c * c + share * s * s, (1.0 - share) * c * s, s * s + share * c * c


def _blur(image: FloatArray, std: float) -> FloatArray:
    """Blur an image by about a Gaussian of ``std`` nodes: three running means in each direction."""
    # Three means over w nodes have the variance 3 (w^2 - 1) / 12.
    half = round(0.5 * (np.sqrt(4.0 * std * std + 1.0) - 1.0))
    for _ in range(3):
        for axis in (0, 1):
            padding = [(0, 0), (0, 0)]
            padding[axis] = (half + 1, half)
            total = np.cumsum(np.pad(image, padding), axis=axis)
            upper = np.take(total, range(2 * half + 1, total.shape[axis]), axis=axis)
            lower = np.take(total, range(image.shape[axis]), axis=axis)
            image = (upper - lower) / (2 * half + 1)
    return image
