"""The beams of one scan where the car's odometry puts them: each at its own time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, Scan
from dart_hal.estimation.localisation.path import Steps, Stretch

LEAST = 60
"""Beams that came back, a tenth of a scan: below, it tells nothing."""


@dataclass(frozen=True, slots=True)
class Beams:
    """points, rays, origin (n, 2) [m] in the axes of the car at the end of ``way``: end points,
    how they go with the relative scale of the distances, and where each beam began."""

    points: FloatArray
    rays: FloatArray
    origin: FloatArray
    way: Stretch


def beams_of(scan: Scan, steps: Steps, errors: FloatArray, late: float, *, deskew: bool = True
             ) -> Beams | None:
    """Those that came back; None where they are too few, or ``steps`` does not cover them.

    errors (4,): of wheels and gyro as ``Steps.stretch`` takes them; late [s]: of the scan's
    stamps. deskew: False puts all beams at the middle of the scan.
    """
    seen = np.flatnonzero(np.isfinite(scan.distance))
    at = scan.t - late
    if len(seen) < LEAST or not steps.covers(float(at[0]), float(at[-1])):
        return None
    way = steps.stretch(float(at[0]), float(at[-1]), errors)
    when = at[seen] if deskew else np.full(len(seen), 0.5 * (at[0] + at[-1]))
    x, y, yaw = (way.at(when) - way.pose[-1]).T
    c, s = np.cos(way.pose[-1, 2]), np.sin(way.pose[-1, 2])
    x, y = c * x + s * y, c * y - s * x
    bearing, reach = scan.bearing[seen] + yaw, scan.range[seen]
    cy, sy = np.cos(yaw), np.sin(yaw)
    mount = scan.mount
    origin = np.column_stack((x + cy * mount.x - sy * mount.y, y + sy * mount.x + cy * mount.y))
    rays = reach[:, None] * np.column_stack((np.cos(bearing), np.sin(bearing)))
    return Beams(origin + rays, rays, origin, way)
