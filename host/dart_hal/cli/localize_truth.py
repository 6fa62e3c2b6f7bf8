"""What a simulator tells of a room: its map, which who owns a real one has, and the true path."""

from __future__ import annotations

import numpy as np

from dart_hal.links.base import Backend
from dart_hal.localisation.field import Map, map_of_lines
from dart_hal.sim.truth import room_of_car, world_of
from dart_hal.types import FloatArray


def map_of_room(backend: Backend) -> Map:
    """Of the room in which a simulated lidar is. Raises UsageError where there is none."""
    return map_of_lines(room_of_car(backend).lines)


def true_path(backend: Backend, t: FloatArray) -> FloatArray:
    """x, y [m], yaw [rad] (n, 3) in the room at times (n,) [s]."""
    x0, y0, yaw0 = room_of_car(backend).start
    x, y, yaw = world_of(backend).poses(t).T
    c, s = np.cos(yaw0), np.sin(yaw0)
    return np.column_stack((x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw))
