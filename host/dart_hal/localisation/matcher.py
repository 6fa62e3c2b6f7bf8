"""The pose at which the end points of one scan lie on the walls of a map: Gauss-Newton.

    minimise  sum rho(d(R p + x)) / SIGMA^2  +  (m - m0)' I (m - m0),     m = x, y, yaw, scale

d: distance field of the map. rho: Geman-McClure, weight 1 / (1 + (d / C)^2)^2; what is far from
every wall (another car, a box that the map does not know) pulls at nothing. The second term is
what is known before: the belief of the filter, so that a corridor leaves its length to the wheels.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from dart_hal.localisation.field import Map
from dart_hal.types import FloatArray

C = 0.08
"""m at which a beam has a quarter of its weight: five times the noise of a distance; 5 cm are as
good, and c larger lets boxes that are not in the map pull."""
FAR = 0.5
"""m from any wall: such a beam is of something that the map does not know."""
SIGMA = 0.019
"""m, one sigma of a distance to a wall. Noise is 1.5 cm; neighbours share the errors of map and
de-skewing, so that their number tells less than it seems: 600 beams count as 370."""
STEPS = 15
SMALL = 3e-4
"""m and rad of a step after which there is no other: the next one is a tenth of it."""


@dataclass(frozen=True, slots=True)
class Match:
    """pose (4,): x, y [m], yaw [rad], scale; info (4, 4): what the scan alone tells of it."""

    pose: FloatArray
    info: FloatArray


def match(chart: Map, points: FloatArray, rays: FloatArray, start: FloatArray,
          known: FloatArray, small: float = SMALL) -> Match:
    """The best pose for one scan, from ``start`` (4,) on, which has the information ``known``.

    points (n, 2) [m]: end points in the axes of the car at one time; rays (n, 2) [m]: how they go
    with the relative error ``scale`` of the distances, which is in them already at scale 0. small
    [m, rad, share]: a step that is the last.
    """
    (px, py), (qx, qy) = np.ascontiguousarray(points.T), np.ascontiguousarray(rays.T)
    pose, jacobian = start.copy(), np.empty((4, len(points)))
    info = known
    for _ in range(STEPS):
        c, s, scale = cos(pose[2]), sin(pose[2]), pose[3]
        qcx, qcy = c * qx - s * qy, s * qx + c * qy
        rx, ry = c * px - s * py + scale * qcx, s * px + c * py + scale * qcy
        d, gx, gy = chart.look(rx + pose[0], ry + pose[1])
        weight = (d <= FAR) / (C**2 + d * d)**2
        weight *= C**4 / SIGMA**2
        jacobian[0], jacobian[1] = gx, gy
        jacobian[2] = gy * rx - gx * ry
        jacobian[3] = gx * qcx + gy * qcy
        weighted = jacobian * weight
        info = weighted @ jacobian.T
        step = np.linalg.solve(info + known, -(weighted @ d) - known @ (pose - start))
        pose = pose + step
        if np.abs(step).max() < small:
            break
    return Match(pose, info)
