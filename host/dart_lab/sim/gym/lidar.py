"""Ranges of a lidar on the car: to boards along the track, and to other cars.

All beams are taken at one instant; ``sim://?lidar=1`` simulates the turning head and the packets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from dart_hal.car.lidar import DEFAULT_MOUNT_X
from dart_hal.control.paths import Path
from dart_hal.control.tracks import track_named
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.rays import LineIndex
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.gym.config import GymConfig
from dart_lab.sim.light.noise import LIDAR_STREAM, Seed, make_stream
from dart_lab.sim.light.world import CAR_OUTLINE

# Distance [m] from the half width of the track, which limits the rear axle, to the boards: half a
# body.
BOARD_OFFSET = 0.1
# Largest distance of a chord from the curve of a board [m]: a third of the noise. Fewer lines are
# quicker.
MAX_CHORD_ERROR = 0.004
# Largest change of the curvature of the track along one line of its boards [1/m].
MAX_CURVATURE_CHANGE = 0.05
# Range of an X4 [m].
MAX_RANGE = 10.0


class RangeSensor:
    """Ranges in ``beams`` directions of a full turn, from straight ahead to the left."""

    def __init__(self, track: Path, c: GymConfig) -> None:
        self.lines = np.vstack([board_lines(track, side * (c.half_width + BOARD_OFFSET))
                                for side in (1.0, -1.0)])
        self.bearing: FloatArray = np.arange(c.beams, dtype=np.float64) * (math.tau / c.beams)
        self._index = LineIndex(self.lines)

    def ranges(self, pose: FloatArray, others: FloatArray) -> FloatArray:
        """Return distances (beams, n) [m] to the nearest board or car.

        pose (3, n): x, y [m], yaw [rad] of n rear axles; others (k, 3, n): those of the k opponents
        of each car.
        """
        x, y, yaw = pose
        direction = yaw + self.bearing[:, None]
        c = np.cos(direction)
        s = np.sin(direction)
        lidar_x = x + DEFAULT_MOUNT_X * np.cos(yaw)
        lidar_y = y + DEFAULT_MOUNT_X * np.sin(yaw)
        shape = (len(self.bearing), pose.shape[1])
        origin = np.column_stack([np.broadcast_to(v, shape).ravel() for v in (lidar_x, lidar_y)])
        hit = self._index.cast(origin, np.column_stack((c.ravel(), s.ravel())))
        reach = np.minimum(hit.reshape(shape), MAX_RANGE)
        for other in others:
            reach = np.minimum(reach, box_distances(lidar_x, lidar_y, c, s, other))
        return reach


def board_lines(track: Path, offset: float) -> FloatArray:
    """Return lines (m, 4) [m] of a board at ``offset`` m to the left of a closed track.

    1. Choose points of the track whose chords stay within MAX_CHORD_ERROR of the curve: a chord of
       length l misses an arc of curvature k by l^2 k / 8. Lines end where the curvature changes.
    2. Drop lines that are closer than ``offset`` to another part of the track, where it crosses
       itself.
    """
    x = track.x - offset * np.sin(track.heading)
    y = track.y + offset * np.cos(track.heading)
    stretch = np.abs(1.0 - offset * track.curvature)
    curvature = np.maximum(np.abs(track.curvature), 0.02)
    chord = np.sqrt(8.0 * MAX_CHORD_ERROR * stretch / curvature) / stretch
    steps = np.maximum((chord / track.spacing).astype(int), 1)
    chosen = [0]
    n = len(x)
    while chosen[-1] < n:
        k = chosen[-1]
        ahead = np.arange(k + 1, min(k + int(steps[k]), n) + 1)
        change = np.abs(track.curvature[ahead % n] - track.curvature[k])
        bends = np.flatnonzero(change > MAX_CURVATURE_CHANGE)
        chosen.append(int(ahead[bends[0] if len(bends) else -1]))
    points = np.column_stack((x, y))[np.array(chosen) % n]
    lines = np.hstack((points[:-1], points[1:]))
    middle = 0.5 * (lines[:, :2] + lines[:, 2:])
    gap = np.hypot(middle[:, :1] - track.x, middle[:, 1:] - track.y).min(axis=1)
    free: FloatArray = lines[gap > abs(offset) - 2.0 * MAX_CHORD_ERROR]
    return free


def box_distances(x: Value, y: Value, c: Value, s: Value, other: Sequence[Value],
                  xp: Any = np) -> Any:
    """Return distances (beams, n) along (c, s) from x, y (n,) to a car's outline, or MAX_RANGE.

    Slab method: in the frame of the outline a ray is between the two sides of an axis for an
    interval of distances. It meets the outline if the intervals of both axes overlap.
    """
    cos = xp.cos(other[2])
    sin = xp.sin(other[2])
    dx = x - other[0]
    dy = y - other[1]
    starts = cos * dx + sin * dy - CAR_OUTLINE.ahead, cos * dy - sin * dx
    directions = cos * c + sin * s, cos * s - sin * c
    halves = 0.5 * CAR_OUTLINE.length, 0.5 * CAR_OUTLINE.width
    enter = xp.zeros_like(c)
    leave = xp.full_like(c, MAX_RANGE)
    for start, direction, half in zip(starts, directions, halves, strict=True):
        slope = xp.where(xp.abs(direction) < 1e-12, 1e-12, direction)
        one = (-half - start) / slope
        two = (half - start) / slope
        enter = xp.maximum(enter, xp.minimum(one, two))
        leave = xp.minimum(leave, xp.maximum(one, two))
    return xp.where(enter < leave, enter, MAX_RANGE)


class CarPoses(Protocol):
    """The part of a task that gives the poses of the car and of its opponents."""

    def rear_axle(self, state: Sequence[Value]) -> tuple[Value, Value, Value]:
        """Return x, y [m], yaw [rad] of the rear axle from a state of the centre of mass."""

    def others(self, kept: tuple[Value, ...]) -> list[tuple[Value, Value, Value]]:
        """Return the same of each opponent, from the memory of the task."""


class LidarObservation:
    """Observed ranges of one environment or many, with their noise; empty without beams."""

    def __init__(self, c: GymConfig, task: CarPoses, *, scalar: bool) -> None:
        self._c = c
        self._task = task
        self._scalar = scalar
        self._sensor = RangeSensor(track_named(c.track), c) if c.beams else None

    def seed(self, seeds: Sequence[Seed]) -> None:
        """Start the noise again, with one seed for each car."""
        if self._c.beams:
            self._noise = make_stream(seeds, LIDAR_STREAM, self._c.beams, self._scalar, "float64")

    def observe(self, state: Sequence[Value], kept: tuple[Value, ...]) -> FloatArray:
        """Return ranges (beams, n) [m] from the true state of the centre of mass."""
        if self._sensor is None:
            return np.empty((0, 1))
        pose = np.atleast_2d(np.array(self._task.rear_axle(state)).T).T
        others = [np.atleast_2d(np.array(other).T).T for other in self._task.others(kept)]
        noise = np.array(self._noise.row()).reshape(self._c.beams, -1)
        reach = self._sensor.ranges(pose, np.array(others))
        return np.maximum(reach + self._c.range_noise * noise, 0.0)
