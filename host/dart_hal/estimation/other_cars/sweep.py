"""Beams of one scan in the room, with the distance to the first wall of the map on each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, Pose
from dart_hal.estimation.localisation.beams import Beams
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.health import AGREEMENT_DISTANCE, AGREEMENT_SHARE

# m from a line of the map within which a point belongs to it, even if its beam misses the line, as
# at an edge.
MIN_LINE_DISTANCE = 0.06


@dataclass(frozen=True, slots=True)
class RoomBeams:
    """Beams that came back, in the order of time.

    t (n,) [s]; origin, direction (n, 2) in the room, direction of length 1; range (n,) [m]; wall
    (n,) [m]: distance to the first line of the map; unexplained (n,): the beam ends before it.
    """

    t: FloatArray
    origin: FloatArray
    direction: FloatArray
    range: FloatArray
    wall: FloatArray
    unexplained: BoolArray

    def select(self, rows: BoolArray) -> RoomBeams:
        """Return the beams of a mask (n,)."""
        return RoomBeams(self.t[rows], self.origin[rows], self.direction[rows], self.range[rows],
                     self.wall[rows], self.unexplained[rows])

    def extend(self, later: RoomBeams) -> RoomBeams:
        """Return these beams and later ones."""
        return RoomBeams(*(np.concatenate((getattr(self, name), getattr(later, name)))
                           for name in ("t", "origin", "direction", "range", "wall",
                                        "unexplained")))

    @property
    def points(self) -> FloatArray:
        """Return the end points (n, 2) [m] in the room."""
        ends: FloatArray = self.origin + self.range[:, None] * self.direction
        return ends


def make_sweep(chart: Map, beams: Beams, pose: Pose) -> RoomBeams:
    """Place the beams of a localised scan in the room.

    pose: of the rear axle at the end of the scan, as ``Located.pose``.
    """
    c = np.cos(pose.yaw)
    s = np.sin(pose.yaw)
    turn = np.array(((c, s), (-s, c)))
    origin = beams.origin @ turn + (pose.x, pose.y)
    rays = beams.rays @ turn
    reach = np.hypot(rays[:, 0], rays[:, 1])
    direction = rays / reach[:, None]
    wall = chart.line_index.cast(origin, direction)
    points = origin + rays
    off_lines = chart.look(points[:, 0], points[:, 1])[0] > MIN_LINE_DISTANCE
    before = reach < wall - AGREEMENT_DISTANCE - AGREEMENT_SHARE * reach
    return RoomBeams(beams.t, origin, direction, reach, wall, before & off_lines)
