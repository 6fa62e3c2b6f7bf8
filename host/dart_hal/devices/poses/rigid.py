"""A rigid body in space as the pose of a car on the floor."""

from __future__ import annotations

from math import atan2, hypot, isfinite, sqrt
from typing import NamedTuple

from dart_hal.devices.poses.reading import Reading

LEVEL = 0.5
"""Least horizontal part of a body's x axis: beyond 60 deg of pitch nobody means a car."""
UNIT = 0.1
"""How far the length of a quaternion may be from 1; float32 is off by 1e-7, other bytes by more."""


class Body(NamedTuple):
    """As a server tells it: name or id, place in its unit, unit quaternion x, y, z, w."""

    name: str
    place: tuple[float, ...]
    turned: tuple[float, ...]


def reading(body: Body, t: float, frame: str, y_up: bool) -> Reading:
    """The body on the floor; yaw is that of its x axis, in a frame with z up.

    y_up: the server's y points up; then its -z is our y. Raises ValueError for
    a body whose x axis stands on end, and for what is no rotation.
    """
    x, y, z, w = body.turned
    length = sqrt(x * x + y * y + z * z + w * w)
    if not (isfinite(length) and abs(length - 1.0) < UNIT):
        raise ValueError(f"{body.name}: a quaternion of length {length:g}")
    nose = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
    east, north = (nose[0], -nose[2]) if y_up else nose[:2]
    if hypot(east, north) < LEVEL:
        raise ValueError(f"{body.name}: its x axis points up or down; "
                         f"is up={'z' if y_up else 'y'} meant?")
    px, py, pz = body.place
    return Reading(body.name, frame, t, px, -pz if y_up else py, atan2(north, east))
