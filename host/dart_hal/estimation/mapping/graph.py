"""Poses that fit what was measured between them: Gauss-Newton on a sparse graph, robustly.

    minimise  sum r' I r  over the steps  +  sum rho(r' I r) over the closures

r: the pose of b in the axes of a, less the measured one. rho is Geman-McClure's, so that a closure
that is wrong pulls at nothing; it is reached from the plain square by graduated non-convexity (Yang
et al., RA-L 5(2), 2020), since before the first solution a right closure is as far off as a wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import spsolve

from dart_hal.core.types import BoolArray, FloatArray, IntArray

RIGHT = 16.3
"""r' I r of three numbers that one right closure in 1000 exceeds: chi squared."""
FASTER = 2.0
"""By which the square becomes robust from step to step."""
STEPS, SMALL = 40, 1e-7
"""m and rad of a step after which there is no other."""


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """step (3,): x, y [m], yaw [rad] of b in the axes of a, as measured; info (3, 3): the inverse
    of its covariance; closes: it may be wrong altogether."""

    a: int
    b: int
    step: FloatArray
    info: FloatArray
    closes: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """poses (n, 3): x, y [m], yaw [rad]; weight (m,) of each edge, 1 = it is believed."""

    poses: FloatArray
    weight: FloatArray


def solve(poses: FloatArray, edges: list[Edge]) -> Solution:
    """The best poses (n, 3), from ``poses`` on; the first stays where it is."""
    a, b = (np.array([getattr(e, k) for e in edges], dtype=int) for k in ("a", "b"))
    told, info = np.array([e.step for e in edges]), np.array([e.info for e in edges])
    closes = np.array([e.closes for e in edges])
    poses, weight, soft = poses.copy(), np.ones(len(edges)), np.inf
    for _ in range(STEPS):
        off, by_a, by_b = _compared(poses[a], poses[b], told)
        weight, soft = _weights(np.einsum("mi,mij,mj->m", off, info, off), closes, soft)
        step = _step(len(poses), a, b, off, by_a, by_b, info * weight[:, None, None])
        poses[1:] += step
        if soft == 1.0 and np.abs(step).max(initial=0.0) < SMALL:
            break
    return Solution(poses, weight)


def between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Poses b (..., 3) in the axes of a (..., 3)."""
    c, s, d = np.cos(a[..., 2]), np.sin(a[..., 2]), b - a
    return np.stack((c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0],
                     _wrapped(d[..., 2])), axis=-1)


def onto(a: FloatArray, step: FloatArray) -> FloatArray:
    """The inverse of ``between``: what is at ``step`` (..., 3) in the axes of a (..., 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack((a[..., 0] + c * step[..., 0] - s * step[..., 1],
                     a[..., 1] + s * step[..., 0] + c * step[..., 1],
                     a[..., 2] + step[..., 2]), axis=-1)


def _wrapped(turn: FloatArray) -> FloatArray:
    wrapped: FloatArray = np.mod(turn + np.pi, 2.0 * np.pi) - np.pi
    return wrapped


def _compared(a: FloatArray, b: FloatArray, told: FloatArray
              ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (m, 3) and how they go with both poses (m, 3, 3)."""
    seen = between(a, b)
    off = seen - told
    off[:, 2] = _wrapped(off[:, 2])
    c, s, zero, one = np.cos(a[:, 2]), np.sin(a[:, 2]), np.zeros(len(a)), np.ones(len(a))
    by_b = np.array(((c, s, zero), (-s, c, zero), (zero, zero, one))).transpose(2, 0, 1)
    by_a = -by_b
    by_a[:, 0, 2], by_a[:, 1, 2] = seen[:, 1], -seen[:, 0]
    return off, by_a, by_b


def _weights(worse: FloatArray, closes: BoolArray, soft: float) -> tuple[FloatArray, float]:
    """Geman-McClure's at scale RIGHT * soft, and that factor, which falls to 1."""
    most = float(worse.max(initial=0.0, where=closes)) / RIGHT
    soft = max(1.0, min(2.0 * most, soft / FASTER))
    scale = RIGHT * soft
    return np.where(closes, (scale / (scale + worse))**2, 1.0), soft


def _step(n: int, a: IntArray, b: IntArray, off: FloatArray, by_a: FloatArray, by_b: FloatArray,
          info: FloatArray) -> FloatArray:
    """What poses 1 .. n - 1 have to move by (n - 1, 3): the normal equations, sparse."""
    rows, columns, blocks = [], [], []
    right = np.zeros((n, 3))
    for p, by_p in ((a, by_a), (b, by_b)):
        weighted = by_p.transpose(0, 2, 1) @ info
        np.add.at(right, p, -(weighted @ off[:, :, None])[:, :, 0])
        for q, by_q in ((a, by_a), (b, by_b)):
            k = np.arange(3)
            rows.append(np.broadcast_to(3 * p[:, None, None] + k[:, None], (len(p), 3, 3)))
            columns.append(np.broadcast_to(3 * q[:, None, None] + k, (len(p), 3, 3)))
            blocks.append(weighted @ by_q)
    i, j, value = (np.concatenate(part).ravel() for part in (rows, columns, blocks))
    system = csc_matrix((value, (i, j)), shape=(3 * n, 3 * n))[3:, 3:]
    step: FloatArray = np.asarray(spsolve(system, right[1:].ravel())).reshape(n - 1, 3)
    return step
