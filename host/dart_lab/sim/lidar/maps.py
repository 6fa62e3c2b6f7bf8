"""Rooms of a simulated lidar: exact lines, and glass.

``room``: 6 x 5 m with inner walls and boxes, drawn from the seed; ``corridor``: a ring of
14 x 10 m, 2 m wide, with cabinets along its walls; ``track``: boards left and right of the
racetrack; ``hall``: a square of 6.5 m around the racetrack, with boxes and glass; ``lane``,
``lane-curve``, ``lane-s``: lanes in a hall; or the YAML file of a map of ROS's map_server. Only
``dart_lab.sim.truth`` gives access to the room of a car: localisation and mapping have to measure.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path as File

import numpy as np

from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.grid import Grid, middle_lines_of_grid, read_grid
from dart_lab.sim.lidar.lanes import HALL_MARGIN, LANE_PATHS, draw_start, lane_boards

# Distance from the middle of the track to its boards [m]; its straights have a distance of 1.5 m.
TRACK_BOARD_OFFSET = 0.35
# Free distance around a start [m]: a circle of 0.46 m radius (at 0.36 rad), and half the car.
START_CLEARANCE = 1.1
# Largest number of random positions for a start.
MAX_START_DRAWS = 200


@dataclass(frozen=True, slots=True)
class RoomMap:
    """Map of a room; lines, glass (m, 4): x1, y1, x2, y2 [m]; start: x, y [m], yaw [rad] of the
    rear axle at the start of the world."""

    name: str
    lines: FloatArray
    glass: FloatArray
    start: tuple[float, float, float]


def box(x: float, y: float, yaw: float, length: float, width: float) -> FloatArray:
    """Return the outline (4, 4) of a box with centre x, y [m]."""
    corners = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1))) * (0.5 * length, 0.5 * width)
    c = math.cos(yaw)
    s = math.sin(yaw)
    return polyline(corners @ np.array(((c, s), (-s, c))) + (x, y), closed=True)


def polyline(points: FloatArray, *, closed: bool = False) -> FloatArray:
    """Return lines (m, 4) from point to point (n, 2)."""
    ends = np.roll(points, -1, axis=0)
    joined: FloatArray = np.hstack((points, ends))
    return joined if closed else joined[:-1]


def clearance(lines: FloatArray, x: float, y: float) -> float:
    """Return the distance from x, y to the nearest line [m]."""
    a = lines[:, :2]
    e = lines[:, 2:] - lines[:, :2]
    p = np.array((x, y)) - a
    along = np.clip(np.einsum("ij,ij->i", p, e) / np.einsum("ij,ij->i", e, e), 0.0, 1.0)
    return float(np.linalg.norm(p - along[:, None] * e, axis=1).min())


def _make_room(rng: np.random.Generator) -> RoomMap:
    """Make a room with two inner walls, four boxes and a metre of glass."""
    length = 6.0
    width = 5.0
    outer = box(0.5 * length, 0.5 * width, 0.0, length, width)
    wall = rng.uniform(1.5, 2.5, 2)
    reach = rng.uniform(1.0, 1.8, 2)
    walls = np.array(((wall[0], 0.0, wall[0], reach[0]),
                      (length - wall[1], width, length - wall[1], width - reach[1])))
    pane = rng.uniform(0.5, width - 1.5)
    glass = np.array(((length, pane, length, pane + 1.0),))
    right = np.array(((length, 0.0, length, pane), (length, pane + 1.0, length, width)))
    outer = outer[~(outer[:, [0, 2]] == length).all(axis=1)]
    lines = np.vstack((outer, right, walls))
    # Four boxes of four lines each, with free space around them.
    while len(lines) < len(outer) + 4 + 16:
        x, y, turn = rng.uniform((0.5, 0.5, 0.0), (length - 0.5, width - 0.5, math.pi))
        if clearance(lines, x, y) > 0.6:
            lines = np.vstack((lines, box(x, y, turn, *rng.uniform(0.2, 0.5, 2))))
    obstacles = np.vstack((lines, glass))
    return RoomMap("room", lines, glass, _draw_start(obstacles, (0, 0, length, width), rng))


def _make_corridor(rng: np.random.Generator) -> RoomMap:
    """Make a corridor with cabinets of 0.3 m along its outer walls."""
    lines = np.vstack((box(7.0, 5.0, 0.0, 14.0, 10.0), box(7.0, 5.0, 0.0, 10.0, 6.0)))
    for x in np.arange(3.0, 12.0, 2.0):
        for wall in (0.15, 9.85):
            lines = np.vstack((lines, box(x + rng.uniform(-0.7, 0.7), wall, 0.0,
                                          rng.uniform(0.3, 0.8), 0.3)))
    for y in (3.0, 5.0, 7.0):
        for wall in (0.15, 13.85):
            lines = np.vstack((lines, box(wall, y + rng.uniform(-0.7, 0.7), 0.0, 0.3,
                                          rng.uniform(0.3, 0.8))))
    return RoomMap("corridor", lines, np.empty((0, 4)), (4.0, 1.0, 0.0))


def _make_track(rng: np.random.Generator) -> RoomMap:
    path = track_named("racetrack_vicon_2")
    normal = np.column_stack((-np.sin(path.heading), np.cos(path.heading)))
    middle = np.column_stack((path.x, path.y))
    boards = [polyline((middle + side * TRACK_BOARD_OFFSET * normal)[::5], closed=True)
              for side in (1, -1)]
    return RoomMap("track", np.vstack(boards), np.empty((0, 4)),
                   (float(path.x[0]), float(path.y[0]), float(path.heading[0])))


def _make_hall(rng: np.random.Generator) -> RoomMap:
    """Make a hall around the racetrack, without boards: a wall, a metre of glass, seven boxes."""
    path = track_named("racetrack_vicon_2")
    low = -1.0
    high = 5.5
    pane = rng.uniform(0.5, 3.0)
    corners = np.array(((high, pane + 1.0), (high, high), (low, high), (low, low), (high, low),
                        (high, pane)))
    glass = np.array(((high, pane, high, pane + 1.0),))
    wall = rng.uniform(0.5, 3.5)
    lines = np.vstack((polyline(corners), (wall, high, wall, high - rng.uniform(0.3, 0.5))))
    boxes = 0
    while boxes < 7:
        x, y, turn = rng.uniform((low, low, 0.0), (high, high, math.pi))
        size = rng.uniform(0.15, 0.4, 2)
        free = np.hypot(path.x - x, path.y - y).min() - 0.5 * np.hypot(*size)
        if free > TRACK_BOARD_OFFSET and clearance(np.vstack((lines, glass)), x, y) > 0.3:
            lines = np.vstack((lines, box(x, y, turn, *size)))
            boxes += 1
    return RoomMap("hall", lines, glass,
                   (float(path.x[0]), float(path.y[0]), float(path.heading[0])))


def _make_lane(name: str, rng: np.random.Generator) -> RoomMap:
    path = LANE_PATHS[name]()
    both = lane_boards(path)
    low, high = (edge(np.vstack(both), axis=0) for edge in (np.min, np.max))
    x, y = 0.5 * (low + high)
    length, width = high - low + 2.0 * HALL_MARGIN
    hall = box(float(x), float(y), 0.0, float(length), float(width))
    return RoomMap(name, np.vstack((hall, *(polyline(b) for b in both))), np.empty((0, 4)),
                   draw_start(path, rng))


ROOMS: dict[str, Callable[[np.random.Generator], RoomMap]] = {
    "room": _make_room, "corridor": _make_corridor, "track": _make_track, "hall": _make_hall,
    **{name: partial(_make_lane, name) for name in LANE_PATHS}}


def _find_walls(grid: Grid) -> FloatArray:
    """Return the walls (m, 4) [m] of a map in cells, where the localiser takes them to be.

    A wall is at the middle of its cells. A single cell is a cross as wide as the cell.
    """
    lines = middle_lines_of_grid(grid)
    single = np.all(lines[:, :2] == lines[:, 2:], axis=1)
    posts = lines[single]
    half = 0.5 * grid.cell
    level = np.array((-half, 0.0, half, 0.0))
    upright = np.array((0.0, -half, 0.0, half))
    return np.vstack((lines[~single], posts + level, posts + upright))


def room_of(name: str, seed: int) -> RoomMap:
    """Return the room of ``map=NAME``. Raises UsageError for unknown names and invalid files."""
    rng = np.random.default_rng([seed, 511])
    if name in ROOMS:
        return ROOMS[name](rng)
    if not name.endswith((".yaml", ".yml")):
        raise UsageError(f"map={name} is no room", found=name,
                         expected=f"{', '.join(ROOMS)}, or the YAML file of a map_server map")
    grid = read_grid(File(name))
    lines = _find_walls(grid)
    if not len(lines):
        raise UsageError(f"{name}: the map has no wall", found="no occupied cell", read=name)
    low = grid.origin
    high = grid.origin + grid.cell * np.array(grid.occupied.shape[::-1])
    return RoomMap(File(name).stem, lines, np.empty((0, 4)),
                   _draw_start(lines, (*low, *high), rng, grid.is_free))


def _draw_start(lines: FloatArray, bounds: tuple[float, ...], rng: np.random.Generator,
                free: Callable[[float, float], bool] = lambda x, y: True
                ) -> tuple[float, float, float]:
    """Draw the first pose with ``START_CLEARANCE`` around it, else that with the largest one."""
    best = (-1.0, 0.0, 0.0)
    for _ in range(MAX_START_DRAWS):
        x, y = rng.uniform(bounds[:2], bounds[2:]).tolist()
        if free(x, y):
            best = max(best, (clearance(lines, x, y), x, y))
            if best[0] > START_CLEARANCE:
                break
    return best[1], best[2], float(rng.uniform(-math.pi, math.pi))
