"""The pose at which the end points of one scan lie on the walls of a map: Gauss-Newton.

    minimise  sum rho(d(R p + x)) / SIGMA^2  +  (m - m0)' I (m - m0),     m = x, y, yaw, scale

d: distance field of the map. rho: Geman-McClure, weight 1 / (1 + (d / C)^2)^2; what is far from
every wall (another car, a box that the map does not know) pulls at nothing. The second term is
what is known before: the belief of the filter, so that a corridor leaves its length to the wheels.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import cos, sin

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.field import Map, map_of_lines
from dart_hal.estimation.localisation.native import function

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


Matcher = Callable[[Map, FloatArray, FloatArray, FloatArray, FloatArray, float], Match]


def match(chart: Map, points: FloatArray, rays: FloatArray, start: FloatArray,
          known: FloatArray, small: float = SMALL) -> Match:
    """The best pose for one scan, from ``start`` (4,) on, which has the information ``known``.

    points (n, 2) [m]: end points in the axes of the car at one time; rays (n, 2) [m]: how they go
    with the relative error ``scale`` of the distances, which is in them already at scale 0. small
    [m, rad, share]: a step that is the last. By C (``match.c``) where there is a compiler.
    """
    return (native() or match_numpy)(chart, points, rays, start, known, small)


def match_numpy(chart: Map, points: FloatArray, rays: FloatArray, start: FloatArray,
                known: FloatArray, small: float = SMALL) -> Match:
    """As ``match``, by numpy."""
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


@lru_cache(maxsize=1)
def native() -> Matcher | None:
    """As ``match``, by C; None where it cannot be had, or says something else than numpy."""
    compiled = function("match", "match.c")
    if compiled is None:
        return None
    number, real, address = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
    compiled.argtypes = [number, address, address, number, number, address, *[real] * 6, address,
                         number, real, address, address]

    def by_c(chart: Map, points: FloatArray, rays: FloatArray, start: FloatArray,
             known: FloatArray, small: float) -> Match:
        p, q, k = (np.ascontiguousarray(a, dtype=np.float64) for a in (points, rays, known))
        pose, info = np.array(start, dtype=np.float64), np.empty((4, 4))
        rows, columns = chart.distance.shape
        compiled(len(p), p.ctypes.data, q.ctypes.data, rows, columns, chart.patch.ctypes.data,
                 chart.origin[0], chart.origin[1], chart.cell, C * C, FAR, SIGMA, k.ctypes.data,
                 STEPS, small, pose.ctypes.data, info.ctypes.data)
        return Match(pose, info)

    return by_c if _agrees(by_c) else None


def _agrees(by_c: Matcher) -> bool:
    """In a room of 4 m x 3 m, from 5 cm and 2 deg aside; beams end up to 2 cm beside the walls."""
    corners = np.array(((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)))
    chart = map_of_lines(np.hstack((corners, np.roll(corners, -1, axis=0))))
    along = np.linspace(0.05, 0.95, 50)[:, None]
    ends = np.vstack([a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0),
                                                          strict=True)])
    ends += 0.02 * np.sin(np.arange(2 * len(ends)).reshape(-1, 2)) - (2.0, 1.0)
    given = chart, ends, ends, np.array((2.03, 0.96, 0.03, 0.0)), 100.0 * np.eye(4), 0.0
    want, got = match_numpy(*given), by_c(*given)
    return bool(np.allclose(got.pose, want.pose, rtol=0.0, atol=1e-9)
                and np.allclose(got.info, want.info, rtol=1e-6, atol=1e-3))
