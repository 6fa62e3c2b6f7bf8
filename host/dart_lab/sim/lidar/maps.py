"""Rooms in which a simulated lidar looks around: lines that are exact, and glass.

``room``: 6 x 5 m with inner walls and boxes, drawn from the seed; ``corridor``: a ring of
14 x 10 m, 2 m wide, with cabinets along its walls; ``track``: boards left and right of the
racetrack; ``hall``: 6.5 m square about the same, with boxes and glass; ``lane``, ``lane-curve``,
``lane-s``: lanes in a hall; or the YAML file of a map as ROS's map_server keeps it. Only
``dart_lab.sim.truth`` tells the room of a car: who localises or maps has to look.
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
from dart_hal.estimation.localisation.grid import lines_of_grid, read_grid
from dart_lab.sim.lidar.lanes import AROUND, LANES, begins, boards

BOARD = 0.35
"""m from the middle of the track to its boards; its straights are 1.5 m apart."""
CLEAR = 1.1
"""m around a start that is free: a circle of 0.46 m radius (0.36 rad), and half the car."""
TRIES = 200


@dataclass(frozen=True, slots=True)
class Room:
    """lines, glass (m, 4): x1, y1, x2, y2 [m]; start: x, y [m], yaw [rad] of the rear axle where
    the world begins."""

    name: str
    lines: FloatArray
    glass: FloatArray
    start: tuple[float, float, float]


def box(x: float, y: float, yaw: float, length: float, width: float) -> FloatArray:
    """Outline (4, 4) of a box about x, y [m]."""
    corners = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1))) * (0.5 * length, 0.5 * width)
    c, s = math.cos(yaw), math.sin(yaw)
    return polyline(corners @ np.array(((c, s), (-s, c))) + (x, y), closed=True)


def polyline(points: FloatArray, *, closed: bool = False) -> FloatArray:
    """Lines (m, 4) from point to point (n, 2)."""
    ends = np.roll(points, -1, axis=0)
    joined: FloatArray = np.hstack((points, ends))
    return joined if closed else joined[:-1]


def clearance(lines: FloatArray, x: float, y: float) -> float:
    """Distance from x, y to the nearest line [m]."""
    a, e = lines[:, :2], lines[:, 2:] - lines[:, :2]
    p = np.array((x, y)) - a
    along = np.clip(np.einsum("ij,ij->i", p, e) / np.einsum("ij,ij->i", e, e), 0.0, 1.0)
    return float(np.linalg.norm(p - along[:, None] * e, axis=1).min())


def _room(rng: np.random.Generator) -> Room:
    """Two walls that stand out from the outer ones, four boxes, a metre of glass."""
    length, width = 6.0, 5.0
    outer = box(0.5 * length, 0.5 * width, 0.0, length, width)
    at, reach = rng.uniform(1.5, 2.5, 2), rng.uniform(1.0, 1.8, 2)
    walls = np.array(((at[0], 0.0, at[0], reach[0]),
                      (length - at[1], width, length - at[1], width - reach[1])))
    pane = rng.uniform(0.5, width - 1.5)
    glass = np.array(((length, pane, length, pane + 1.0),))
    right = np.array(((length, 0.0, length, pane), (length, pane + 1.0, length, width)))
    outer = outer[~(outer[:, [0, 2]] == length).all(axis=1)]
    lines = np.vstack((outer, right, walls))
    while len(lines) < len(outer) + 4 + 16:
        x, y, turn = rng.uniform((0.5, 0.5, 0.0), (length - 0.5, width - 0.5, math.pi))
        if clearance(lines, x, y) > 0.6:
            lines = np.vstack((lines, box(x, y, turn, *rng.uniform(0.2, 0.5, 2))))
    everything = np.vstack((lines, glass))
    return Room("room", lines, glass, _start(everything, (0, 0, length, width), rng))


def _corridor(rng: np.random.Generator) -> Room:
    """Cabinets of 0.3 m stand along the outer and the inner walls, on both sides."""
    lines = np.vstack((box(7.0, 5.0, 0.0, 14.0, 10.0), box(7.0, 5.0, 0.0, 10.0, 6.0)))
    for x in np.arange(3.0, 12.0, 2.0):
        for wall in (0.15, 9.85):
            lines = np.vstack((lines, box(x + rng.uniform(-0.7, 0.7), wall, 0.0,
                                          rng.uniform(0.3, 0.8), 0.3)))
    for y in (3.0, 5.0, 7.0):
        for wall in (0.15, 13.85):
            lines = np.vstack((lines, box(wall, y + rng.uniform(-0.7, 0.7), 0.0, 0.3,
                                          rng.uniform(0.3, 0.8))))
    return Room("corridor", lines, np.empty((0, 4)), (4.0, 1.0, 0.0))


def _track(rng: np.random.Generator) -> Room:
    path = track_named("racetrack_vicon_2")
    normal = np.column_stack((-np.sin(path.heading), np.cos(path.heading)))
    middle = np.column_stack((path.x, path.y))
    boards = [polyline((middle + side * BOARD * normal)[::5], closed=True) for side in (1, -1)]
    return Room("track", np.vstack(boards), np.empty((0, 4)),
                (float(path.x[0]), float(path.y[0]), float(path.heading[0])))


def _hall(rng: np.random.Generator) -> Room:
    """A metre around the racetrack, no board beside it: a wall, a metre of glass, seven boxes."""
    path = track_named("racetrack_vicon_2")
    low, high = -1.0, 5.5
    pane = rng.uniform(0.5, 3.0)
    corners = np.array(((high, pane + 1.0), (high, high), (low, high), (low, low), (high, low),
                        (high, pane)))
    glass = np.array(((high, pane, high, pane + 1.0),))
    at = rng.uniform(0.5, 3.5)
    lines = np.vstack((polyline(corners), (at, high, at, high - rng.uniform(0.3, 0.5))))
    boxes = 0
    while boxes < 7:
        x, y, turn = rng.uniform((low, low, 0.0), (high, high, math.pi))
        size = rng.uniform(0.15, 0.4, 2)
        free = np.hypot(path.x - x, path.y - y).min() - 0.5 * np.hypot(*size)
        if free > BOARD and clearance(np.vstack((lines, glass)), x, y) > 0.3:
            lines, boxes = np.vstack((lines, box(x, y, turn, *size))), boxes + 1
    return Room("hall", lines, glass,
                (float(path.x[0]), float(path.y[0]), float(path.heading[0])))


def _lane(name: str, rng: np.random.Generator) -> Room:
    path = LANES[name]()
    both = boards(path)
    low, high = (edge(np.vstack(both), axis=0) for edge in (np.min, np.max))
    (x, y), (length, width) = 0.5 * (low + high), high - low + 2.0 * AROUND
    hall = box(float(x), float(y), 0.0, float(length), float(width))
    return Room(name, np.vstack((hall, *(polyline(b) for b in both))), np.empty((0, 4)),
                begins(path, rng))


ROOMS: dict[str, Callable[[np.random.Generator], Room]] = {
    "room": _room, "corridor": _corridor, "track": _track, "hall": _hall,
    **{name: partial(_lane, name) for name in LANES}}


def room_of(name: str, seed: int) -> Room:
    """The room of ``map=NAME``. Raises UsageError for an unknown name and a file that is no map."""
    rng = np.random.default_rng([seed, 511])
    if name in ROOMS:
        return ROOMS[name](rng)
    if not name.endswith((".yaml", ".yml")):
        raise UsageError(f"map={name} is no room", found=name,
                         expected=f"{', '.join(ROOMS)}, or the YAML file of a map_server map")
    grid = read_grid(File(name))
    lines = lines_of_grid(grid)
    if not len(lines):
        raise UsageError(f"{name}: the map has no wall", found="no occupied cell", read=name)
    low, high = grid.origin, grid.origin + grid.cell * np.array(grid.occupied.shape[::-1])
    return Room(File(name).stem, lines, np.empty((0, 4)),
                _start(lines, (*low, *high), rng, grid.is_free))


def _start(lines: FloatArray, within: tuple[float, ...], rng: np.random.Generator,
           free: Callable[[float, float], bool] = lambda x, y: True
           ) -> tuple[float, float, float]:
    """A place with room around it: the first that has ``CLEAR``, else the one with most."""
    best = (-1.0, 0.0, 0.0)
    for _ in range(TRIES):
        x, y = rng.uniform(within[:2], within[2:]).tolist()
        if free(x, y):
            best = max(best, (clearance(lines, x, y), x, y))
            if best[0] > CLEAR:
                break
    return best[1], best[2], float(rng.uniform(-math.pi, math.pi))
