"""Scan matching by Gauss-Newton: the pose at which the end points of a scan lie on map walls.

    minimise  sum rho(d(R (p + scale q) + x)) / sigma^2  +  (m - m0)' I (m - m0)

    m = x, y, yaw, scale     R: rotation by yaw; p: end points of the scan; q: their change by scale
    rho(d) = d^2 / (1 + (d / C)^2)     Geman-McClure; as a weight of d^2: 1 / (1 + (d / C)^2)^2

sigma and C of a beam grow with its noise (``range_noise.py``).

d: distance field of the map. Points far from every wall (another car, an unknown box) have no
influence. The second term is the prior of the filter: in a corridor, wheels determine the position
along it.
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
from dart_hal.estimation.localisation.native import load_function

# m at which a beam has a quarter of its weight: five times the noise of a distance. 5 cm are as
# good; with a larger c boxes that are not in the map bias the pose.
C = 0.08
# m from any wall: such a beam is of something unknown to the map.
MAX_WALL_DISTANCE = 0.5
# m, one sigma of a distance to a wall. Noise is 1.5 cm; neighbours share the errors of map and de-
# skewing, so that 600 beams have the information of 370.
WALL_DISTANCE_STD = 0.019
MAX_ITERATIONS = 15
# m and rad of a step that is the last: the next one would be a tenth of it.
STEP_TOLERANCE = 3e-4


@dataclass(frozen=True, slots=True)
class Match:
    """pose (4,): x, y [m], yaw [rad], scale; info (4, 4): information of the scan alone."""

    pose: FloatArray
    info: FloatArray


Matcher = Callable[
    [Map, FloatArray, FloatArray, FloatArray, FloatArray, float, FloatArray], Match]


def match(chart: Map, points: FloatArray, rays: FloatArray, start: FloatArray,
          known: FloatArray, small: float = STEP_TOLERANCE,
          spread: FloatArray | None = None) -> Match:
    """Return the best pose for one scan, from ``start`` (4,), whose information is ``known``.

    points (n, 2) [m]: end points in the axes of the car at one time; rays (n, 2) [m]: their
    derivative by the relative error ``scale`` of the distances. small [m, rad, share]: largest
    last step. spread (n,): factor of sigma and C of each beam, 1 without.
    Runs in C (``match.c``) if there is a compiler.
    """
    spread = np.ones(len(points)) if spread is None else spread
    return (native_match() or match_numpy)(chart, points, rays, start, known, small, spread)


def match_numpy(chart: Map, points: FloatArray, rays: FloatArray, start: FloatArray,
                known: FloatArray, small: float = STEP_TOLERANCE,
                spread: FloatArray | None = None) -> Match:
    """Implement ``match`` in NumPy.

    1. Transform the points and look up distance and gradient in the field.
    2. Robust weights, Jacobian by x, y, yaw, scale.
    3. Solve the normal equations with the prior; repeat until the step is small.
    """
    (px, py) = np.ascontiguousarray(points.T)
    (qx, qy) = np.ascontiguousarray(rays.T)
    spread2 = np.ones(len(points)) if spread is None else spread * spread
    pose = start.copy()
    jacobian = np.empty((4, len(points)))
    info = known
    for _ in range(MAX_ITERATIONS):
        c = cos(pose[2])
        s = sin(pose[2])
        scale = pose[3]
        qcx = c * qx - s * qy
        qcy = s * qx + c * qy
        rx = c * px - s * py + scale * qcx
        ry = s * px + c * py + scale * qcy
        d, gx, gy = chart.look(rx + pose[0], ry + pose[1])
        weight = (d <= MAX_WALL_DISTANCE) * spread2 / (C**2 * spread2 + d * d)**2
        weight *= C**4 / WALL_DISTANCE_STD**2
        jacobian[0] = gx
        jacobian[1] = gy
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
def native_match() -> Matcher | None:
    """Return ``match`` in C; None if not available, or different from NumPy."""
    compiled = load_function("match", "match.c")
    if compiled is None:
        return None
    number = ctypes.c_int64
    real = ctypes.c_double
    address = ctypes.c_void_p
    compiled.argtypes = [number, *[address] * 3, number, number, address, *[real] * 6, address,
                         number, real, address, address]

    def match_c(chart: Map, points: FloatArray, rays: FloatArray, start: FloatArray,
                known: FloatArray, small: float, spread: FloatArray) -> Match:
        p, q, k, f = (np.ascontiguousarray(a, dtype=np.float64)
                      for a in (points, rays, known, spread))
        pose = np.array(start, dtype=np.float64)
        info = np.empty((4, 4))
        rows, columns = chart.distance.shape
        compiled(len(p), p.ctypes.data, q.ctypes.data, f.ctypes.data, rows, columns,
                 chart.patch.ctypes.data, chart.origin[0], chart.origin[1], chart.cell, C * C,
                 MAX_WALL_DISTANCE,
                 WALL_DISTANCE_STD, k.ctypes.data,
                 MAX_ITERATIONS, small, pose.ctypes.data, info.ctypes.data)
        return Match(pose, info)

    return match_c if _is_equal(match_c) else None


def _is_equal(match_c: Matcher) -> bool:
    """Compare with NumPy in a room of 4 m x 3 m, from a start off by 5 cm and 2 deg."""
    corners = np.array(((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)))
    chart = map_of_lines(np.hstack((corners, np.roll(corners, -1, axis=0))))
    along = np.linspace(0.05, 0.95, 50)[:, None]
    ends = np.vstack([a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0),
                                                          strict=True)])
    ends += 0.02 * np.sin(np.arange(2 * len(ends)).reshape(-1, 2)) - (2.0, 1.0)
    spread = np.linspace(1.0, 3.0, len(ends))
    arguments = (chart, ends, ends, np.array((2.03, 0.96, 0.03, 0.0)), 100.0 * np.eye(4), 0.0,
                 spread)
    expected = match_numpy(*arguments)
    result = match_c(*arguments)
    return bool(np.allclose(result.pose, expected.pose, rtol=0.0, atol=1e-9)
                and np.allclose(result.info, expected.info, rtol=1e-6, atol=1e-3))
