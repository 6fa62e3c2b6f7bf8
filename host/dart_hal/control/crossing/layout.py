"""Lanes that meet: their paths, where their common ground begins and ends, who limits whom."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from zlib import crc32

import numpy as np

from dart_hal.control.crossing.speed import stopping_distance
from dart_hal.control.crossing.table import distances, lines
from dart_hal.control.paths import Path
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# m between the middles of two cars, by their paths: 0.35 m, and twice what a pose (1.5 cm) and a
# controller (3.5 cm) err by.
APART = 0.45
# Cosine of two headings that face each other: within 6 deg.
OPPOSITE = -0.995
# m beside each other: one lane.
SAME = 0.02


@dataclass(frozen=True)
class Route:
    """A way through: name, the lane in which it comes, path of the car's middle (open)."""

    name: str
    lane: str
    path: Path


class Layout:
    """Routes and what they have in common.

    entry (n,) [m]: where the ground begins that a car of another lane may want; exit (n,) [m]:
    behind it there is none but of who goes the same way.
    """

    def __init__(
        self, name: str, routes: tuple[Route, ...], speed: float, apart: float = APART
    ) -> None:
        """speed [m/s]: of the cars; apart [m]: see ``APART``. Raises UsageError for lanes that
        are closer, and for one that is too short to stop in."""
        self.name = name
        self.routes = routes
        self.speed = speed
        self.apart = apart
        between = [[distances(a.path, b.path) for b in routes] for a in routes]
        self._lines = [
            [lines(d, b.path, apart) for d, b in zip(row, routes, strict=True)] for row in between
        ]
        grounds = [self._ground(a, row) for a, row in zip(routes, between, strict=True)]
        self.entry = tuple(begin for begin, _ in grounds)
        self.exit = tuple(end for _, end in grounds)
        for k, route in enumerate(routes):
            self.checked_start(k, 0.0)
            if self.exit[k] >= route.path.length:
                raise UsageError(
                    f"{name}: route {route.name} ends on common ground",
                    found=f"{route.path.length:.2f} m long",
                    expected=f"more than {self.exit[k]:.2f} m",
                )

    def number(self, route: str) -> int:
        """Of a route by its name. Raises UsageError."""
        names = [r.name for r in self.routes]
        if route not in names:
            raise UsageError(
                f"{self.name} has no route {route}", found=route, expected=", ".join(names)
            )
        return names.index(route)

    def key(self, names: tuple[str, ...]) -> int:
        """Of this layout with these cars: programs that have others do not understand each
        other."""
        ends = [
            f"{r.name} {r.path.length:.3f} {e:.3f}"
            for r, e in zip(self.routes, self.entry, strict=True)
        ]
        return crc32("; ".join((self.name, f"{self.apart:.3f}", *ends, *names)).encode())

    def line(self, a: int, s: float, b: int) -> float:
        """B_ab(s) [m]: how far a car on route b may go while one on route a is at s [m]."""
        table = self._lines[a][b]
        spacing = self.routes[a].path.spacing
        return float(table[min(max(int(s / spacing), 0), len(table) - 1)])

    def checked_start(self, route: int, s: float) -> None:
        """Raises UsageError for a start [m] from which a car could not stop before the ground."""
        needed = stopping_distance(self.speed)
        if self.entry[route] - s < needed:
            raise UsageError(
                f"{self.name}: route {self.routes[route].name} starts too near",
                found=f"{self.entry[route] - s:.2f} m before the common ground",
                expected=f"{needed:.2f} m, to stop from {self.speed:g} m/s",
            )

    def _ground(self, a: Route, between: list[FloatArray]) -> tuple[float, float]:
        """(begin, end) [m] of what cars of other lanes may want. Raises UsageError."""
        begin = inf
        end = 0.0
        s = a.path.s
        for b, apart in zip(self.routes, between, strict=True):
            if b.lane == a.lane:
                continue
            self._faced(a, b, apart[0])
            least = apart.min(axis=1)
            on = np.flatnonzero(least < self.apart)
            if len(on):
                beside = on[least[on] > SAME]
                begin = min(begin, float(s[on[0]]) - a.path.spacing)
                end = max(end, float(s[beside[-1]]) + self.apart)
        return begin, end

    def _faced(self, a: Route, b: Route, apart: FloatArray) -> None:
        """apart (n_b,) [m]: from the start of a, where it is alone in its lane."""
        facing = np.cos(a.path.heading[0] - b.path.heading) < OPPOSITE
        least = float(np.where(facing, apart, inf).min())
        if least < self.apart:
            raise UsageError(
                f"{self.name}: the lanes of {a.name} and {b.name} are too near to each other",
                found=f"{least:.2f} m apart",
                expected=f"{self.apart:g} m between the middles of two cars",
                remedy="draw them further apart: two cars that meet there would touch",
            )
