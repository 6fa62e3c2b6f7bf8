"""Beams of one scan, placed by the odometry of the car: each at its own time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, Scan
from dart_hal.estimation.localisation.path import OdometrySteps, Stretch
from dart_hal.estimation.localisation.range_noise import RangeNoise

# Returned beams, a tenth of a scan: fewer are not enough for a match.
MIN_BEAMS = 60


@dataclass(frozen=True, slots=True)
class Beams:
    """Beams of one scan in the axes of the car at the end of ``stretch``.

    points, rays, origin (n, 2) [m]: end points, their derivative by the relative scale of the
    distances, and the start of each beam; spread (n,): of the noise, as ``RangeNoise`` returns it;
    t (n,) [s]: time of each.
    """

    points: FloatArray
    rays: FloatArray
    origin: FloatArray
    spread: FloatArray
    stretch: Stretch
    t: FloatArray


def place_beams(scan: Scan, steps: OdometrySteps, errors: FloatArray, latency: float,
                noise: RangeNoise | None = None, *, deskew: bool = True) -> Beams | None:
    """Return the beams that came back; None if too few, or not covered by ``steps``.

    errors (4,): of wheels and gyro as ``OdometrySteps.stretch`` takes them; latency [s]: of the
    stamps of the scan; noise: learnt of the lidar, without it constant. deskew: False places all
    beams at the middle of the scan.
    """
    returned = np.flatnonzero(np.isfinite(scan.distance))
    stamps = scan.t - latency
    if len(returned) < MIN_BEAMS or not steps.covers(float(stamps[0]), float(stamps[-1])):
        return None
    stretch = steps.stretch(float(stamps[0]), float(stamps[-1]), errors)
    times = stamps[returned] if deskew else np.full(len(returned), 0.5 * (stamps[0] + stamps[-1]))
    x, y, yaw = (stretch.interpolate(times) - stretch.pose[-1]).T
    c = np.cos(stretch.pose[-1, 2])
    s = np.sin(stretch.pose[-1, 2])
    x, y = c * x + s * y, c * y - s * x
    bearing = scan.bearing[returned] + yaw
    range_ = scan.range[returned]
    cy = np.cos(yaw)
    sy = np.sin(yaw)
    mount = scan.mount
    origin = np.column_stack((x + cy * mount.x - sy * mount.y, y + sy * mount.x + cy * mount.y))
    rays = range_[:, None] * np.column_stack((np.cos(bearing), np.sin(bearing)))
    spread = np.ones(len(range_)) if noise is None else noise.spread(range_)
    return Beams(origin + rays, rays, origin, spread, stretch, times)
