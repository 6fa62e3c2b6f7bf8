"""Projection of a rigid body in space to the pose of a car on the floor."""

from __future__ import annotations

from math import atan2, hypot, isfinite, sqrt
from typing import NamedTuple

from dart_hal.devices.poses.reading import PoseReading

# Horizontal part of a body's unit x axis: with a pitch above 60 deg it is not a car's.
MIN_HORIZONTAL = 0.5
# Deviation of the norm of a quaternion from 1: float32 rounding gives 1e-7, wrong bytes much more.
MAX_NORM_ERROR = 0.1


class RigidBody(NamedTuple):
    """A body as sent by a server: name or id, position in its unit, unit quaternion x, y, z, w."""

    name: str
    position: tuple[float, ...]
    quaternion: tuple[float, ...]


def project_to_floor(body: RigidBody, t: float, frame: str, y_up: bool) -> PoseReading:
    """Project a body to the floor; yaw is that of its x axis, in a frame with z up.

    y_up: the server's y axis points up; its -z axis then is y here. Raises ValueError for a body
    whose x axis is near the vertical, and for a quaternion that is not a rotation.
    """
    x, y, z, w = body.quaternion
    length = sqrt(x * x + y * y + z * z + w * w)
    if not (isfinite(length) and abs(length - 1.0) < MAX_NORM_ERROR):
        raise ValueError(f"{body.name}: a quaternion of length {length:g}")
    nose = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
    east, north = (nose[0], -nose[2]) if y_up else nose[:2]
    if hypot(east, north) < MIN_HORIZONTAL:
        raise ValueError(f"{body.name}: its x axis points up or down; "
                         f"try up={'z' if y_up else 'y'}")
    px, py, pz = body.position
    return PoseReading(body.name, frame, t, px, -pz if y_up else py, atan2(north, east))
