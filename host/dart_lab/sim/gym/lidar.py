"""What a lidar on the car would tell: boards along the track, and other cars.

All beams are of one instant; ``sim://?lidar=1`` has the turning head and the packets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from dart_hal.car.lidar import DEFAULT_MOUNT_X
from dart_hal.control.paths import Path
from dart_hal.control.tracks import track_named
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.rays import fastest_cast
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.gym.config import GymConfig
from dart_lab.sim.light.noise import LIDAR, Seed, streams
from dart_lab.sim.light.world import Outline

BESIDE = 0.1
"""m from the half width of the track, where the rear axle may be, to its boards: half a body."""
FLAT = 0.004
"""m by which a chord may miss a board: a third of the noise. Fewer lines are quicker."""
BENT = 0.05
"""1/m from one point of a track to another on one line of its boards."""
MOST = 10.0
"""m, the furthest that an X4 tells."""
BODY = Outline()


class Eyes:
    """Ranges of ``beams`` directions, from straight ahead on to the left, all around."""

    def __init__(self, track: Path, c: GymConfig) -> None:
        self.lines = np.vstack([board(track, side * (c.half_width + BESIDE))
                                for side in (1.0, -1.0)])
        self.bearing: FloatArray = np.arange(c.beams, dtype=np.float64) * (math.tau / c.beams)
        self._cast = fastest_cast()

    def ranges(self, pose: FloatArray, others: FloatArray) -> FloatArray:
        """Distances (beams, n) [m] to the nearest thing, for rear axles (3, n) at x, y [m], yaw
        [rad]; others (k, 3, n): the rear axles that each of them sees."""
        x, y, yaw = pose
        way = yaw + self.bearing[:, None]
        c, s = np.cos(way), np.sin(way)
        at_x, at_y = x + DEFAULT_MOUNT_X * np.cos(yaw), y + DEFAULT_MOUNT_X * np.sin(yaw)
        shape = (len(self.bearing), pose.shape[1])
        origin = np.column_stack([np.broadcast_to(v, shape).ravel() for v in (at_x, at_y)])
        hit = self._cast(self.lines, origin, np.column_stack((c.ravel(), s.ravel())))
        reach = np.minimum(hit.reshape(shape), MOST)
        for other in others:
            reach = np.minimum(reach, _to_box(at_x, at_y, c, s, other))
        return reach


def board(track: Path, aside: float) -> FloatArray:
    """Lines (m, 4) [m] ``aside`` m to the left of a closed track; none within that of another part
    of it, where tracks cross or meet."""
    x, y = track.x - aside * np.sin(track.heading), track.y + aside * np.cos(track.heading)
    stretch = np.abs(1.0 - aside * track.curvature)
    chord = np.sqrt(8.0 * FLAT * stretch / np.maximum(np.abs(track.curvature), 0.02)) / stretch
    steps = np.maximum((chord / track.spacing).astype(int), 1)
    chosen, n = [0], len(x)
    while chosen[-1] < n:
        k = chosen[-1]
        ahead = np.arange(k + 1, min(k + int(steps[k]), n) + 1)
        turned = np.flatnonzero(np.abs(track.curvature[ahead % n] - track.curvature[k]) > BENT)
        chosen.append(int(ahead[turned[0] if len(turned) else -1]))
    at = np.column_stack((x, y))[np.array(chosen) % n]
    lines = np.hstack((at[:-1], at[1:]))
    middle = 0.5 * (lines[:, :2] + lines[:, 2:])
    gap = np.hypot(middle[:, :1] - track.x, middle[:, 1:] - track.y).min(axis=1)
    kept: FloatArray = lines[gap > abs(aside) - 2.0 * FLAT]
    return kept


def _to_box(x: FloatArray, y: FloatArray, c: FloatArray, s: FloatArray,
            other: FloatArray) -> FloatArray:
    """Distances (beams, n) along (c, s) from x, y (n,) to a car's outline, ``MOST`` past it."""
    cos, sin = np.cos(other[2]), np.sin(other[2])
    dx, dy = x - other[0], y - other[1]
    starts = cos * dx + sin * dy - BODY.ahead, cos * dy - sin * dx
    ways = cos * c + sin * s, cos * s - sin * c
    enter, leave = np.zeros_like(c), np.full_like(c, MOST)
    for start, way, half in zip(starts, ways, (0.5 * BODY.length, 0.5 * BODY.width), strict=True):
        way = np.where(np.abs(way) < 1e-12, 1e-12, way)
        one, two = (-half - start) / way, (half - start) / way
        enter = np.maximum(enter, np.minimum(one, two))
        leave = np.minimum(leave, np.maximum(one, two))
    return np.where(enter < leave, enter, MOST)


class SeesOthers(Protocol):
    """Of a task: where the car is, and where the others are."""

    def rear_axle(self, state: Sequence[Value]) -> tuple[Value, Value, Value]:
        """x, y [m], yaw [rad] of a state of the centre of mass."""

    def others(self, kept: tuple[Value, ...]) -> list[tuple[Value, Value, Value]]:
        """The same of each opponent, from what the task keeps."""


class Sight:
    """The observed ranges of one environment or many, with their noise; nothing without beams."""

    def __init__(self, c: GymConfig, task: SeesOthers, *, scalar: bool) -> None:
        self._c, self._task, self._scalar = c, task, scalar
        self._eyes = Eyes(track_named(c.track), c) if c.beams else None

    def seed(self, seeds: Sequence[Seed]) -> None:
        """Begin the noise anew: one seed for each car, as its sensors have."""
        if self._c.beams:
            self._noise = streams(seeds, LIDAR, self._c.beams, self._scalar, "float64")

    def observe(self, state: Sequence[Value], kept: tuple[Value, ...]) -> FloatArray:
        """Ranges (beams, n) [m] from the true state of the centre of mass."""
        if self._eyes is None:
            return np.empty((0, 1))
        pose = np.atleast_2d(np.array(self._task.rear_axle(state)).T).T
        others = [np.atleast_2d(np.array(other).T).T for other in self._task.others(kept)]
        noise = np.array(self._noise.row()).reshape(self._c.beams, -1)
        reach = self._eyes.ranges(pose, np.array(others))
        return np.maximum(reach + self._c.range_noise * noise, 0.0)
