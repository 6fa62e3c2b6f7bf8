"""Hidden drives with another car and people: scans of a localised car, and the true other car.

Rooms and own car are those of ``studies.localisation``. The other car and the people wander through
the same room by themselves, through each other if it so happens. A person is two legs of 12 cm,
which swing, so each foot rests half of the time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray, Mount, Scan
from dart_hal.estimation.localisation.rays import LineIndex, fastest_cast
from dart_lab.sim.lidar.maps import RoomMap, box
from dart_lab.sim.light.world import CAR_OUTLINE
from studies.localisation.world import DT, Drive, Hidden, drive, hidden, wander

LEG_RADIUS = 0.06
LEG_CORNERS = 8
HIP = 0.11
STEP = 0.25
STEPS_PER_M = 1.0
# Beams that see the others at one time: 4 ms, as in the simulator.
BEAMS_PER_PART = 20


@dataclass(frozen=True)
class Scene:
    """drive: of the own car; other (n, 3): axle of the other car at ``drive.t``, None without one;
    speed: its speed (n,); hits: beams that truly ended on it, of each scan; walks (n, 4): x, y,
    course, distance of each person."""

    drive: Drive
    other: FloatArray | None
    speed: FloatArray
    hits: list[int]
    walks: list[FloatArray]

    def true(self, t: float) -> FloatArray:
        """x, y, yaw, speed of the other car."""
        columns = (*self.other.T, self.speed)
        return np.array([np.interp(t, self.drive.t, column) for column in columns])


def scene(seed: int, *, car: bool = True, people: int = 1, speed: float = 1.0,
          seconds: float = 30.0, **fixed: float) -> Scene:
    """The own car drives at 1 m/s, the other at speeds around ``speed`` [m/s], people at 0.4 to
    1.2 m/s. Raises AssertionError for a room without a way."""
    hid = replace(hidden(seed, seconds=seconds, **fixed), other=False)
    own = drive(seed, hid)
    rng = np.random.default_rng([seed, 31])
    n = len(own.t)
    other = _driven(own.room, speed, n, rng) if car else None
    walks = [_simulate_walk(own.room, n, rng) for _ in range(people)]
    velocity = np.zeros(n)
    if other is not None:
        velocity = np.hypot(*np.gradient(other[:, :2], DT, axis=0).T)
    hits: list[int] = []
    scans = list(_scans(own, hid, other, walks, np.random.default_rng([seed, 32]), hits))
    return Scene(replace(own, scans=scans), other, velocity, hits, walks)


def _driven(room: RoomMap, speed: float, n: int, rng: np.random.Generator) -> FloatArray:
    """Axle poses (n, 3) of a car that is slow and fast in turn, up to 1.5 m/s2; 0 m/s: at rest."""
    if speed == 0.0:
        way = wander(room, 1.0, 1.0, rng)
        return np.repeat(way[:1, :3], n, axis=0)
    way = wander(room, speed, 1.5 * n * DT, rng)
    t = DT * np.arange(n)
    share = 1.0 + 0.35 * np.sin(rng.uniform(0.6, 1.2) * t + rng.uniform(0.0, 6.3))
    at = np.cumsum(share)
    index = np.arange(len(way))
    return np.column_stack([np.interp(at, index, column) for column in way[:, :3].T])


def _simulate_walk(room: RoomMap, n: int, rng: np.random.Generator) -> FloatArray:
    """x, y [m], course [rad], distance [m] (n, 4) of a person."""
    speed = float(rng.uniform(0.4, 1.2))
    way = wander(room, speed, n * DT + 1.0, rng)[:n]
    return np.column_stack((way[:, :3], speed * DT * np.arange(n)))


def _legs(person: FloatArray) -> FloatArray:
    """Lines (16, 4) of both legs: each moves at twice the speed of the body, or rests."""
    x, y, course, distance = person
    lines = []
    ring = 2.0 * np.pi * np.arange(LEG_CORNERS) / LEG_CORNERS
    for side in (1.0, -1.0):
        phase = np.mod(STEPS_PER_M * distance + 0.25 * side, 1.0)
        swing = STEP * (4.0 * abs(phase - 0.5) - 1.0)
        px = x + swing * np.cos(course) - side * HIP * np.sin(course)
        py = y + swing * np.sin(course) + side * HIP * np.cos(course)
        corners = np.column_stack((px + LEG_RADIUS * np.cos(ring), py + LEG_RADIUS * np.sin(ring)))
        lines.append(np.hstack((corners, np.roll(corners, -1, axis=0))))
    return np.vstack(lines)


def _body(pose: FloatArray) -> FloatArray:
    """Lines (4, 4) of a car's body."""
    x, y, yaw = pose
    return box(x + CAR_OUTLINE.ahead * np.cos(yaw), y + CAR_OUTLINE.ahead * np.sin(yaw), yaw,
               CAR_OUTLINE.length, CAR_OUTLINE.width)


def _scans(own: Drive, hid: Hidden, other: FloatArray | None, walks: list[FloatArray],
           rng: np.random.Generator, hits: list[int]):
    """Whole revolutions, as those of ``studies.localisation``."""
    beams = round(5000.0 / hid.rate)
    turn = np.arange(beams) * (2.0 * np.pi / beams)
    cast = fastest_cast()
    there = LineIndex(own.lines)
    panes = LineIndex(own.room.glass)
    first = own.t[0] + 0.05
    while first + beams * 2e-4 + 0.02 < own.t[-1]:
        when = first + 2e-4 * np.arange(beams)
        first = when[-1] + 2e-4
        x, y, yaw = (np.interp(when, own.t, column) for column in own.truth.T)
        ahead = yaw - hid.sense * turn
        origin = np.column_stack((x + 0.13 * np.cos(yaw), y + 0.13 * np.sin(yaw)))
        way = np.column_stack((np.cos(ahead), np.sin(ahead)))
        r = there.cast(origin, way)
        count = 0
        for a in range(0, beams, BEAMS_PER_PART):
            part = slice(a, a + BEAMS_PER_PART)
            k = min(int((when[a] - own.t[0]) / DT), len(own.t) - 1)
            for walk in walks:
                r[part] = np.minimum(r[part], cast(_legs(walk[k]), origin[part], way[part]))
            if other is not None:
                body = cast(_body(other[k]), origin[part], way[part])
                count += int(np.sum(body < r[part]))
                r[part] = np.minimum(r[part], body)
        hits.append(count)
        r[panes.cast(origin, way) < r] = np.nan
        r[(r > 10.0) | (r < 0.12)] = np.nan
        r = (r + rng.normal(size=beams) * (hid.noise + hid.noise_share * r)) / hid.scale
        r[rng.uniform(size=beams) < hid.dropout] = np.nan
        stamps = when + hid.late
        yield Scan(float(stamps[-1]) + 0.01, float(stamps[0]), hid.rate, stamps - stamps[0], turn,
                   r, 0.0, Mount(x=0.13))
