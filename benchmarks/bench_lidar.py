"""The simulated lidar: rays against lines, whole scans down to their bytes, and their decoding;
and how many scans a second are laid on a map.

    python benchmarks/bench_lidar.py
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from figures import Figure, best_cpu

from dart_hal.core.types import FloatArray
from dart_hal.devices.lidar.scan import LidarStream
from dart_hal.estimation.localisation import matcher
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.rays import Cast, cast_numpy, native_cast
from dart_lab.sim.lidar.maps import room_of
from dart_lab.sim.lidar.params import LidarParams
from dart_lab.sim.lidar.unit import LidarUnit

BEAMS = 606
ROUNDS = 20
SEED = 1


def pose_at_rest(t: FloatArray) -> FloatArray:
    """Return the poses (n, 3) of a car at rest."""
    return np.zeros((len(t), 3))


def scans_per_s(cast: Cast, name: str, scans: int) -> float:
    """Scans of 606 beams per CPU second from as many places in a room, the best of several."""
    room = room_of(name, SEED)
    x, y, _ = room.start
    turn = np.linspace(0.0, 2.0 * np.pi, BEAMS, endpoint=False)
    direction = np.column_stack((np.cos(turn), np.sin(turn)))
    places = np.array((x, y)) + np.random.default_rng(SEED).uniform(-0.5, 0.5, (scans, 2))
    origins = [np.tile(place, (BEAMS, 1)) for place in places]

    def work() -> None:
        for origin in origins:
            cast(room.lines, origin, direction)

    return scans / best_cpu(work, ROUNDS)


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
            match(chart, points, points, start, known, matcher.STEP_TOLERANCE)

    return scans / best_cpu(work, ROUNDS)


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows for the table of all figures."""
    many, rows = max(int(100 * scale), 20), []
    compiled = native_cast()
    for name in ("room", "corridor", "track"):
        lines = len(room_of(name, SEED).lines)
        rows.append(Figure(f"lidar: {name} of {lines} lines, numpy",
                           scans_per_s(cast_numpy, name, many), "scans/s",
                           1000.0 if name == "room" else None))
        if compiled is not None:
            rows.append(Figure(f"lidar: {name} of {lines} lines, kernel",
                               scans_per_s(compiled, name, many), "scans/s",
                               15e3 if name == "room" else None))
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
