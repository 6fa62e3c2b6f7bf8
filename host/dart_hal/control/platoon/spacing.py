"""The gap to the car ahead: by the lidar, or by the reported pose.

    lidar    points of a scan within the corridor of the own path, the nearest cluster of them
    report   the reported position of the predecessor; used if the lidar finds nothing

The nearest cluster must not be hit, whatever it is, so it need not be the predecessor.
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.control.platoon.follower import Gap
from dart_hal.core.types import FloatArray

# Distance from the rear axle to the front and to the rear end of a car [m]
# (docs/reference/hardware.md).
FRONT_LENGTH = 0.2375
REAR_LENGTH = 0.0625
# Half width of the corridor [m]: half a body, 0.095, and 5 cm; boards are at 0.35.
CORRIDOR_HALF_WIDTH = 0.15
# Largest distance at which a car is searched [m]: six gaps.
MAX_GAP_DISTANCE = 3.0
# Points within a depth [m] that form a cluster: a tail 1.5 m ahead is hit by a dozen beams.
MIN_CLUSTER_POINTS = 3
CLUSTER_DEPTH = 0.06
# Largest error of a gap by the lidar [m]: 1.5 % of a distance, 5 mm of a mean of beams, the age of
# a scan; and by the poses of two cars at 1 m/s with an age of 0.1 s.
LIDAR_GAP_ERROR = 0.05
REPORTED_GAP_ERROR = 0.20


def measure_gap(points: FloatArray, t: FloatArray, path: Path, s: FloatArray) -> Gap | None:
    """Return the gap by the end points (n, 2) [m] of a scan, or None if the corridor is free.

    t (n,) [s]: times of the points; s (n,) [m]: arc length of the own rear axle at these times.
    """
    if not len(points):
        return None
    arc_length, offset = _project_on_path(points, path, float(s[-1]))
    gap = arc_length - s - FRONT_LENGTH
    inside = (
        (np.abs(offset) < CORRIDOR_HALF_WIDTH) & (gap > -FRONT_LENGTH) & (gap < MAX_GAP_DISTANCE)
    )
    if not inside.any():
        return None
    order = np.argsort(gap[inside])
    near = gap[inside][order]
    times = t[inside][order]
    cluster_ends = np.searchsorted(near, near + CLUSTER_DEPTH)
    clusters = np.flatnonzero(cluster_ends - np.arange(len(near)) >= MIN_CLUSTER_POINTS)
    if not len(clusters):
        return None
    k = slice(int(clusters[0]), int(cluster_ends[clusters[0]]))
    return Gap(float(times[k].mean()), float(np.median(near[k])), LIDAR_GAP_ERROR)


def gap_from_pose(x: float, y: float, t: float, path: Path, s: float) -> Gap:
    """Return the gap by the reported rear axle x, y [m] at t [s]; s [m]: the own arc length."""
    s_predecessor = path.closest(x, y, s + FRONT_LENGTH + REAR_LENGTH)
    return Gap(t, s_predecessor - REAR_LENGTH - s - FRONT_LENGTH, REPORTED_GAP_ERROR)


def _project_on_path(points: FloatArray, path: Path, s: float) -> tuple[FloatArray, FloatArray]:
    """Return arc length [m] and offset [m] of points, relative to the part of the path ahead of s.
    """
    grid = s + np.arange(0.0, FRONT_LENGTH + MAX_GAP_DISTANCE, 2.0 * path.spacing)
    if not path.closed:
        grid = grid[grid <= path.length]
    x, y, heading = np.array([path.interpolate(float(one))[:3] for one in grid]).T
    k = np.argmin((points[:, 0, None] - x) ** 2 + (points[:, 1, None] - y) ** 2, axis=1)
    dx = points[:, 0] - x[k]
    dy = points[:, 1] - y[k]
    c = np.cos(heading[k])
    sn = np.sin(heading[k])
    return grid[k] + c * dx + sn * dy, c * dy - sn * dx
