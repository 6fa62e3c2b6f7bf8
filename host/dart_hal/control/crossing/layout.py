"""Lanes that meet: their paths, begin and end of their common ground, and stop lines."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from zlib import crc32

import numpy as np

from dart_hal.control.crossing.speed import stopping_distance
from dart_hal.control.crossing.table import point_distances, stop_lines
from dart_hal.control.paths import Path
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# Smallest distance between the centres of two cars, by their paths [m]: 0.35 m, and twice the
# errors of a pose (1.5 cm) and a controller (3.5 cm).
MIN_CAR_DISTANCE = 0.45
# Cosine of two opposite headings: within 6 deg.
OPPOSITE_COSINE = -0.995
# Largest distance of paths in one lane [m].
SAME_LANE_DISTANCE = 0.02


@dataclass(frozen=True)
class Route:
    """A route through the layout: name, lane in which it comes, path of the centre of the car
    (open).
    """

    name: str
    lane: str
    path: Path


class CrossingLayout:
    """Routes and their common ground.

    entry (n,) [m]: begin of the ground that cars of other lanes may need; exit (n,) [m]: its end,
    except for cars of the same direction.
    """

    def __init__(
        self,
        name: str,
        routes: tuple[Route, ...],
        speed: float,
        min_distance: float = MIN_CAR_DISTANCE,
    ) -> None:
        """speed [m/s]: of the cars; min_distance [m]: see ``MIN_CAR_DISTANCE``. Raises UsageError
        for lanes that are closer, and for one that is too short to stop in.
        """
        self.name = name
        self.routes = routes
        self.speed = speed
        self.min_distance = min_distance
        distances = [[point_distances(a.path, b.path) for b in routes] for a in routes]
        self._lines = [
            [stop_lines(d, b.path, min_distance) for d, b in zip(row, routes, strict=True)]
            for row in distances
        ]
        grounds = [self._common_ground(a, row) for a, row in zip(routes, distances, strict=True)]
        self.entry = tuple(begin for begin, _ in grounds)
        self.exit = tuple(end for _, end in grounds)
        for k, route in enumerate(routes):
            self.check_start(k, 0.0)
            if self.exit[k] >= route.path.length:
                raise UsageError(
                    f"{name}: route {route.name} ends on common ground",
                    found=f"{route.path.length:.2f} m long",
                    expected=f"more than {self.exit[k]:.2f} m",
                )

    def number(self, route: str) -> int:
        """Return the number of a route by its name. Raises UsageError."""
        names = [r.name for r in self.routes]
        if route not in names:
            raise UsageError(
                f"{self.name} has no route {route}", found=route, expected=", ".join(names)
            )
        return names.index(route)

    def key(self, names: tuple[str, ...]) -> int:
        """Return a checksum of this layout with these cars; programs with other ones reject
        messages.
        """
        ends = [
            f"{r.name} {r.path.length:.3f} {e:.3f}"
            for r, e in zip(self.routes, self.entry, strict=True)
        ]
        return crc32("; ".join((self.name, f"{self.min_distance:.3f}", *ends, *names)).encode())

    def line(self, a: int, s: float, b: int) -> float:
        """Return B_ab(s) [m]: limit of a car on route b while one on route a is at s [m]."""
        table = self._lines[a][b]
        spacing = self.routes[a].path.spacing
        return float(table[min(max(int(s / spacing), 0), len(table) - 1)])

    def check_start(self, route: int, s: float) -> None:
        """Raise UsageError for a start [m] from which a car could not stop before the ground."""
        required = stopping_distance(self.speed)
        if self.entry[route] - s < required:
            raise UsageError(
                f"{self.name}: route {self.routes[route].name} starts too near",
                found=f"{self.entry[route] - s:.2f} m before the common ground",
                expected=f"{required:.2f} m, to stop from {self.speed:g} m/s",
            )

    def _common_ground(self, a: Route, distances: list[FloatArray]) -> tuple[float, float]:
        """Return (begin, end) [m] of the ground that cars of other lanes may need."""
        begin = inf
        end = 0.0
        s = a.path.s
        for b, distance in zip(self.routes, distances, strict=True):
            if b.lane == a.lane:
                continue
            self._check_opposite_lanes(a, b, distance[0])
            nearest = distance.min(axis=1)
            common = np.flatnonzero(nearest < self.min_distance)
            if len(common):
                separate = common[nearest[common] > SAME_LANE_DISTANCE]
                begin = min(begin, float(s[common[0]]) - a.path.spacing)
                end = max(end, float(s[separate[-1]]) + self.min_distance)
        return begin, end

    def _check_opposite_lanes(self, a: Route, b: Route, distance: FloatArray) -> None:
        """Raise UsageError for opposite lanes that are too close.

        distance (n_b,) [m]: from the start of a, where it is alone in its lane.
        """
        facing = np.cos(a.path.heading[0] - b.path.heading) < OPPOSITE_COSINE
        nearest = float(np.where(facing, distance, inf).min())
        if nearest < self.min_distance:
            raise UsageError(
                f"{self.name}: the lanes of {a.name} and {b.name} are too near to each other",
                found=f"a distance of {nearest:.2f} m",
                expected=f"{self.min_distance:g} m between the centres of two cars",
                remedy="increase their distance: two cars that meet there would touch",
            )
