"""Pose graph: poses that fit measured relative poses, by robust sparse Gauss-Newton.

    minimise  sum r' I r  over the steps  +  sum rho(r' I r) over the closures

r: the pose of b in the axes of a, minus the measured one. rho is that of Geman and McClure, so that
a wrong closure has no influence. It is approached from the square by graduated non-convexity (Yang
et al., RA-L 5(2), 2020), because before the first solution right closures are off as far as wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import spsolve

from dart_hal.core.types import BoolArray, FloatArray, IntArray

# r' I r of three numbers that one right closure in 1000 exceeds: chi squared.
MAX_CLOSURE_DISTANCE2 = 16.3
# Reduction of the convexity from step to step.
CONVEXITY_FACTOR = 2.0
MAX_ITERATIONS = 40
# m and rad of the last step.
STEP_TOLERANCE = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """Measured relative pose.

    step (3,): x, y [m], yaw [rad] of b in the axes of a; info (3, 3): inverse of its covariance;
    is_closure: it may be completely wrong.
    """

    a: int
    b: int
    step: FloatArray
    info: FloatArray
    is_closure: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """poses (n, 3): x, y [m], yaw [rad]; weight (m,) of each edge, 1 = fully used."""

    poses: FloatArray
    weight: FloatArray


def solve(poses: FloatArray, edges: list[Edge]) -> Solution:
    """Return the best poses (n, 3), starting at ``poses``; the first one is fixed.

    1. Residuals and Jacobians of the edges.
    2. Robust weights; the convexity falls to 1.
    3. Sparse normal equations; repeat until the step is small.
    """
    a, b = (np.array([getattr(e, k) for e in edges], dtype=int) for k in ("a", "b"))
    measured = np.array([e.step for e in edges])
    info = np.array([e.info for e in edges])
    is_closure = np.array([e.is_closure for e in edges])
    poses = poses.copy()
    weight = np.ones(len(edges))
    convexity = np.inf
    for _ in range(MAX_ITERATIONS):
        residual, jacobian_a, jacobian_b = _residuals(poses[a], poses[b], measured)
        distance2 = np.einsum("mi,mij,mj->m", residual, info, residual)
        weight, convexity = _robust_weights(distance2, is_closure, convexity)
        step = _solve_step(len(poses), a, b, residual, jacobian_a, jacobian_b,
                           info * weight[:, None, None])
        poses[1:] += step
        if convexity == 1.0 and np.abs(step).max(initial=0.0) < STEP_TOLERANCE:
            break
    return Solution(poses, weight)


def relative_pose(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return poses b (..., 3) in the axes of a (..., 3)."""
    c = np.cos(a[..., 2])
    s = np.sin(a[..., 2])
    d = b - a
    return np.stack((c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0],
                     _wrap_angle(d[..., 2])), axis=-1)


def compose_pose(a: FloatArray, step: FloatArray) -> FloatArray:
    """Inverse of ``relative_pose``: the pose at ``step`` (..., 3) in the axes of a (..., 3)."""
    c = np.cos(a[..., 2])
    s = np.sin(a[..., 2])
    return np.stack((a[..., 0] + c * step[..., 0] - s * step[..., 1],
                     a[..., 1] + s * step[..., 0] + c * step[..., 1],
                     a[..., 2] + step[..., 2]), axis=-1)


def _wrap_angle(turn: FloatArray) -> FloatArray:
    """Return the angle within half a turn."""
    angle: FloatArray = np.mod(turn + np.pi, 2.0 * np.pi) - np.pi
    return angle


def _residuals(a: FloatArray, b: FloatArray, measured: FloatArray
               ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (m, 3) and their Jacobians by both poses (m, 3, 3)."""
    relative = relative_pose(a, b)
    residual = relative - measured
    residual[:, 2] = _wrap_angle(residual[:, 2])
    c = np.cos(a[:, 2])
    s = np.sin(a[:, 2])
    zero = np.zeros(len(a))
    one = np.ones(len(a))
    jacobian_b = np.array(((c, s, zero), (-s, c, zero), (zero, zero, one))).transpose(2, 0, 1)
    jacobian_a = -jacobian_b
    jacobian_a[:, 0, 2] = relative[:, 1]
    jacobian_a[:, 1, 2] = -relative[:, 0]
    return residual, jacobian_a, jacobian_b


def _robust_weights(distance2: FloatArray, is_closure: BoolArray, convexity: float
                    ) -> tuple[FloatArray, float]:
    """Geman-McClure weights at scale MAX_CLOSURE_DISTANCE2 * convexity, and the new convexity."""
    largest = float(distance2.max(initial=0.0, where=is_closure)) / MAX_CLOSURE_DISTANCE2
    convexity = max(1.0, min(2.0 * largest, convexity / CONVEXITY_FACTOR))
    scale = MAX_CLOSURE_DISTANCE2 * convexity
    return np.where(is_closure, (scale / (scale + distance2))**2, 1.0), convexity


def _solve_step(n: int, a: IntArray, b: IntArray, residual: FloatArray, jacobian_a: FloatArray,
                jacobian_b: FloatArray, info: FloatArray) -> FloatArray:
    """Step (n - 1, 3) of poses 1 .. n - 1: the sparse normal equations."""
    rows = []
    columns = []
    blocks = []
    right = np.zeros((n, 3))
    for p, jacobian_p in ((a, jacobian_a), (b, jacobian_b)):
        weighted = jacobian_p.transpose(0, 2, 1) @ info
        np.add.at(right, p, -(weighted @ residual[:, :, None])[:, :, 0])
        for q, jacobian_q in ((a, jacobian_a), (b, jacobian_b)):
            k = np.arange(3)
            rows.append(np.broadcast_to(3 * p[:, None, None] + k[:, None], (len(p), 3, 3)))
            columns.append(np.broadcast_to(3 * q[:, None, None] + k, (len(p), 3, 3)))
            blocks.append(weighted @ jacobian_q)
    i, j, value = (np.concatenate(part).ravel() for part in (rows, columns, blocks))
    system = csc_matrix((value, (i, j)), shape=(3 * n, 3 * n))[3:, 3:]
    step: FloatArray = np.asarray(spsolve(system, right[1:].ravel())).reshape(n - 1, 3)
    return step
