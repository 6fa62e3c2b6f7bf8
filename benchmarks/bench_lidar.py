"""The simulated lidar: rays against lines, whole scans down to their bytes, and their decoding;
and what it costs to match and to localise a scan.

    python benchmarks/bench_lidar.py
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from figures import Figure, best_cpu
from sphere_tracing import make_sphere_tracer

from dart_hal.core.types import FloatArray
from dart_hal.devices.lidar.scan import LidarStream
from dart_hal.estimation.localisation import matcher
from dart_hal.estimation.localisation.field import Map, map_of_grid, map_of_lines
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.estimation.localisation.localiser import Localiser
from dart_hal.estimation.localisation.rays import (
    MIN_LINES_OF_GRID,
    LineIndex,
    cast_grid_numpy,
    cast_numpy,
    fastest_cast,
    make_grid,
    native_grid_cast,
)
from dart_hal.estimation.localisation.search import search, search_period
from dart_lab.sim.lidar.maps import room_of
from dart_lab.sim.lidar.params import LidarParams
from dart_lab.sim.lidar.unit import LidarUnit

BEAMS = 606
ROUNDS = 20
SEED = 1


def pose_at_rest(t: FloatArray) -> FloatArray:
    """Return the poses (n, 3) of a car at rest."""
    return np.zeros((len(t), 3))


Rays = Callable[[FloatArray, FloatArray], FloatArray]
"""Distances (n,) [m] of rays from points (n, 2) [m] along unit vectors (n, 2)."""


def full_turn() -> FloatArray:
    """Return the directions (606, 2) of a scan."""
    turn = np.linspace(0.0, 2.0 * np.pi, BEAMS, endpoint=False)
    return np.column_stack((np.cos(turn), np.sin(turn)))


def draw_places(start: tuple[float, float, float], scans: int) -> FloatArray:
    """Return points (scans, 2) [m] near the start of a room."""
    return np.array(start[:2]) + np.random.default_rng(SEED).uniform(-0.5, 0.5, (scans, 2))


def scans_per_s(rays: Rays, name: str, scans: int) -> float:
    """Scans of 606 beams per CPU second from as many places in a room, the best of several."""
    direction = full_turn()
    places = draw_places(room_of(name, SEED).start, scans)
    origins = [np.tile(place, (BEAMS, 1)) for place in places]

    def work() -> None:
        for origin in origins:
            rays(origin, direction)

    return scans / best_cpu(work, ROUNDS)


def cast_without_c(lines: FloatArray) -> Rays:
    """Return what ``LineIndex.cast`` does without a compiler."""
    if len(lines) < MIN_LINES_OF_GRID:
        return lambda origin, direction: cast_numpy(lines, origin, direction)
    grid = make_grid(lines)
    return lambda origin, direction: cast_grid_numpy(grid, origin, direction)


def divide_lines(lines: FloatArray, number: int) -> FloatArray:
    """Divide the longest of the lines (m, 4) in halves until there are ``number``."""
    parts = list(lines)
    while len(parts) < number:
        parts.sort(key=lambda line: np.hypot(*(line[2:] - line[:2])))
        line = parts.pop()
        middle = 0.5 * (line[:2] + line[2:])
        parts += [np.concatenate((line[:2], middle)), np.concatenate((middle, line[2:]))]
    return np.array(parts)


def index_rows(scans: int) -> list[Figure]:
    """Cost of the index by the number of lines: the walls of one room, divided."""
    room = room_of("room", SEED)
    direction = full_turn()
    origins = [np.tile(place, (BEAMS, 1)) for place in draw_places(room.start, scans)]
    cost, rows = {}, []
    for number in (23, 56, 460, 2000):
        lines = divide_lines(room.lines, number)
        index = LineIndex(lines)
        tracer = make_sphere_tracer(lines, BEAMS)
        ways: list[Callable[[FloatArray], object]] = [
            lambda o, index=index: index.cast(o, direction),
            lambda o, lines=lines: fastest_cast()(lines, o, direction)]
        if tracer is not None:
            ways.append(lambda o, tracer=tracer: tracer(*o[0]))
        # In turn, so that other work on the machine concerns all of them.
        times = np.min([[best_cpu(lambda way=way: [way(o) for o in origins], 1)
                         for way in ways] for _ in range(ROUNDS)], axis=0)
        cost[number] = times[0]
        rows.append(Figure(f"lidar: index over all pairs, {number} lines", times[1] / times[0],
                           "times"))
        if tracer is not None and number in (56, 460):
            rows.append(Figure(f"lidar: index over sphere tracing, {number} lines",
                               times[2] / times[0], "times", 2.0))
    return [Figure("lidar: cost of 2000 lines over that of 23", cost[2000] / cost[23], "times",
                   None, 1.3), *rows]


def map_of_cells(lines: FloatArray, cell: float = 0.02) -> Map:
    """Return the map of a grid in which the cells on lines are occupied."""
    low = lines.reshape(-1, 2).min(axis=0) - 0.1
    high = lines.reshape(-1, 2).max(axis=0) + 0.1
    columns, rows = np.ceil((high - low) / cell).astype(int)
    occupied = np.zeros((rows, columns), dtype=bool)
    for line in lines:
        share = np.linspace(0.0, 1.0, int(np.hypot(*(line[2:] - line[:2])) / (0.1 * cell)) + 2)
        column, row = ((line[:2] + share[:, None] * (line[2:] - line[:2]) - low) / cell
                       ).astype(int).T
        occupied[row, column] = True
    return map_of_grid(Grid(occupied, ~occupied, cell, low))


def localiser_rows(seconds: float) -> list[Figure]:
    """CPU of a scan with a known pose, and of searches while the car is lost."""
    room = room_of("room", SEED)
    stream = LidarStream()
    unit = LidarUnit(pose_at_rest, room, LidarParams(), SEED)
    scans = [scan for data, t in unit.chunks(seconds) for scan in stream.feed(data, t)]
    rows = []
    for kind, chart in (("lines", map_of_lines(room.lines)), ("cells", map_of_cells(room.lines))):
        localiser = Localiser(chart, room.start)
        for k in range(round(100.0 * seconds) + 20):
            localiser.update_odometry(0.01 * k, 0.0, 0.0, 0.0)
        spent = [best_cpu(partial(localiser.add, scan), 1) for scan in scans]
        assert localiser.belief is not None
        rows.append(Figure(f"lidar: scan localised, {len(chart.lines)} {kind}",
                           1e3 * float(np.median(spent)), "ms", None, 0.8,
                           note=f"least {1e3 * min(spent):.2f} ms"))
    direction = full_turn()
    chart = map_of_lines(room.lines)
    reach = chart.line_index.cast(np.tile(room.start[:2], (BEAMS, 1)), direction)
    points = (reach[:, None] * direction)[reach < 10.0]
    spent_searching = best_cpu(lambda: search(chart, points, points, np.zeros_like(points)), 5)
    rows.append(Figure("lidar: search while lost, share of a core",
                       spent_searching / search_period(chart), "", None, 0.25,
                       note=f"{1e3 * spent_searching:.0f} ms every {search_period(chart):.2f} s"))
    return rows


def matches_per_s(match: matcher.Matcher, scans: int) -> float:
    """Scans of a room per CPU second, with noise of 1.5 cm, from 3 cm and 1 deg aside."""
    room, rng = room_of("room", SEED), np.random.default_rng(SEED)
    chart, (x, y, _) = map_of_lines(room.lines), room.start
    turn = np.linspace(0.0, 2.0 * np.pi, BEAMS, endpoint=False)
    direction = np.column_stack((np.cos(turn), np.sin(turn)))
    reach = cast_numpy(room.lines, np.tile((x, y), (BEAMS, 1)), direction)
    has_return = reach < 10.0
    known = np.diag(1.0 / np.array((0.02, 0.02, 0.01, 0.002))**2)
    start = np.array((x + 0.02, y - 0.02, 0.02, 0.0))
    each = [((reach + 0.015 * rng.normal(size=BEAMS))[:, None] * direction)[has_return]
            for _ in range(scans)]

    def work() -> None:
        for points in each:
            match(chart, points, points, start, known, matcher.STEP_TOLERANCE,
                  np.ones(len(points)))

    return scans / best_cpu(work, ROUNDS)


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows for the table of all figures."""
    many, rows = max(int(100 * scale), 20), []
    for name in ("room", "corridor", "track"):
        index = LineIndex(room_of(name, SEED).lines)
        lines = len(index.lines)
        rows.append(Figure(f"lidar: {name} of {lines} lines, numpy",
                           scans_per_s(cast_without_c(index.lines), name, many), "scans/s",
                           1000.0 if name == "room" else None))
        if native_grid_cast() is not None:
            rows.append(Figure(f"lidar: {name} of {lines} lines, kernel",
                               scans_per_s(index.cast, name, many), "scans/s",
                               15e3 if name == "room" else None))
    rows += [*index_rows(many // 4), *localiser_rows(10.0 * max(scale, 0.3))]
    matched = [matches_per_s(m, many) for m in (matcher.match_numpy, matcher.native_match()) if m]
    rows += [Figure(f"lidar: scans laid on a map, {name}", rate, "scans/s", target)
             for name, rate, target in zip(("numpy", "kernel"), matched, (1e3, 5e3), strict=False)]
    if len(matched) == 2:
        rows.append(Figure("lidar: scans laid on a map, kernel over numpy", matched[1] / matched[0],
                           "times", 3.0))
    made, read = _per_second(10.0 * max(scale, 0.3))
    return [*rows, Figure("lidar: packets made, per second of the car", made, "ms"),
            Figure("lidar: packets into scans, per second of the car", read, "ms")]


def _per_second(seconds: float) -> tuple[float, float]:
    """CPU ms per second of the car: to make the bytes, and to make scans of them."""
    came: list[tuple[bytes, float]] = []

    def make() -> None:
        came[:] = LidarUnit(pose_at_rest, room_of("room", SEED), LidarParams(),
                            SEED).chunks(seconds)

    def read() -> None:
        stream = LidarStream()
        for data, t in came:
            stream.feed(data, t)

    def cost(work: Callable[[], None]) -> float:
        return 1e3 * best_cpu(work, 5) / seconds

    return cost(make), cost(read)


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.name:<50}{figure.measured:>20}   target {figure.target}")
