"""Truth about a simulated room: its map, which the owner of a real room has, and the true path."""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import START_FRAME, FloatArray
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.estimation.localisation.field import Map, map_of_lines
from dart_hal.estimation.localisation.source import FRAME
from dart_lab.sim.truth import room_of_car, room_of_url, world_of


def map_of_room(backend: Backend) -> Map:
    """Return the map of the room of a simulated lidar. Raises UsageError without a lidar."""
    return map_of_lines(room_of_car(backend).lines)


def lines_by_frame(text: str) -> dict[str, FloatArray]:
    """Return lines (m, 4) [m] of the room of a simulated car's URL by frame.

    The frames are that of the car's start and that of the room. Empty for a car without a room.
    """
    url = Url.parse(text)
    room = room_of_url(url) if url.scheme == "sim" else None
    if room is None:
        return {}
    x, y, yaw = room.start
    c = np.cos(yaw)
    s = np.sin(yaw)
    ends = (room.lines.reshape(-1, 2) - (x, y)) @ np.array(((c, -s), (s, c)))
    return {START_FRAME: ends.reshape(-1, 4), FRAME: room.lines}


def true_path(backend: Backend, t: FloatArray) -> FloatArray:
    """Return x, y [m], yaw [rad] (n, 3) in the room at times (n,) [s]."""
    x0, y0, yaw0 = room_of_car(backend).start
    x, y, yaw = world_of(backend).poses(t).T
    c = np.cos(yaw0)
    s = np.sin(yaw0)
    return np.column_stack((x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw))
