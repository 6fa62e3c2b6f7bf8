"""Covariances of a fit with correlated residuals, and directions that the data do not determine.

Residuals of a drive are correlated over a quarter of a second and more, so standard errors that
count samples are several times too small. Here the samples are divided into blocks (whole
recordings, or stretches of some seconds). Blocks are independent; inside a block any correlation
is allowed. With J the Jacobian, W the weights and r_b the residuals of block b:

    H = J'WJ + prior I,     g_b = J_b' W_b r_b
    covariance = H^-1 (sum_b g_b g_b') H^-1      (cluster-robust sandwich)

Source: A. C. Cameron and D. L. Miller, "A Practitioner's Guide to Cluster-Robust Inference"
(2015); ``leverage_covariance`` is "CR3" of R. M. Bell and D. F. McCaffrey (2002).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.least_squares import Solution

# Lower limit of 1 - leverage of a block: the correction of its residuals is at most tenfold.
MIN_RESIDUAL_SHARE = 0.1
# Recordings are the blocks from this number on. A sandwich over fewer has too few degrees of
# freedom, so blocks are then stretches of recordings.
MIN_RECORDING_BLOCKS = 8
# Share of all samples in one recording. If one holds more, recordings are not used as blocks.
MAX_RECORDING_SHARE = 0.35
# Eigenvalue of the normal matrix, scaled to unit diagonal; a direction below is undetermined.
NULL_EIGENVALUE = 1e-11


def plain_covariance(s: Solution) -> FloatArray:
    """Compute the covariance (k, k) for independent residuals, s^2 (J'J)^-1."""
    n, k = s.jacobian.shape
    variance = float(s.residual @ s.residual) / max(n - k, 1)
    return _infinite_where_undetermined(variance * scaled_inverse(s.jacobian.T @ s.jacobian), s)


def block_covariance(s: Solution, block: IntArray, prior: float | FloatArray = 0.0, *,
                     count_parameters: bool = False) -> FloatArray:
    """Compute the covariance (k, k) by the sandwich over independent blocks (n,) of samples.

    H^-1 (sum_b g_b g_b') H^-1 B / (B - 1) with B blocks; infinite for fewer than two.

    Args:
        s: the fit.
        block: block of each sample (n,).
        prior: weight of a prior |x|^2 of unit variance in the sum of squares, one number or (k,).
            A direction that the data do not determine then keeps variance 1.
        count_parameters: the factor is B / (B - p) with p = trace(H^-1 J'WJ), the number of
            parameters that the data determine: at the fit the gradients are smaller than at the
            true parameters.
    """
    k = s.jacobian.shape[1]
    weighted = s.jacobian * s.weight[:, None]
    # 1. H^-1 with H = J'WJ + prior I.
    normal = weighted.T @ s.jacobian
    hessian = scaled_inverse(normal + prior * np.eye(k))
    labels, index = np.unique(block, return_inverse=True)
    if len(labels) < 2:
        return np.full((k, k), np.inf)
    # 2. g_b = J_b' W_b r_b: the sum over the samples of each block.
    gradient = np.zeros((len(labels), k))
    np.add.at(gradient, index, weighted * s.residual[:, None])
    gradient -= gradient.mean(axis=0)  # with a prior, the sum over the data is not zero
    # 3. Sum of g_b g_b', times B / (B - 1) or B / (B - p). The prior adds a gradient of its own:
    #    with x of unit variance, prior * x has the variance prior^2.
    blocks = len(labels)
    determined = float(np.trace(hessian @ normal)) if count_parameters else 1.0
    free = max(blocks - max(determined, 1.0), MIN_RESIDUAL_SHARE * blocks)
    meat = gradient.T @ gradient * blocks / free + prior**2 * np.eye(k)
    covariance = np.asarray(hessian @ meat @ hessian)
    return covariance if np.any(prior) else _infinite_where_undetermined(covariance, s)


def fixed_value_covariance(s: Solution, columns: FloatArray, prior: float = 0.0) -> FloatArray:
    """Compute the covariance (k, k) due to errors of quantities that the fit kept fixed.

    One standard error of fixed quantity j changes the residuals by column j of (n, h), and the
    parameters by d_j = -H^-1 J'W column_j. The errors are independent: covariance = sum_j d_j d_j'.
    prior: as in ``block_covariance``.
    """
    weighted = s.jacobian * s.weight[:, None]
    hessian = weighted.T @ s.jacobian + prior * np.eye(s.jacobian.shape[1])
    shift = scaled_inverse(hessian) @ (weighted.T @ columns)
    return np.asarray(shift @ shift.T)


def leverage_covariance(s: Solution, block: IntArray) -> FloatArray:
    """Compute the covariance (k, k) by the sandwich with leverage-corrected residuals (CR3).

    With few blocks, or if a few determine the fit, ``block_covariance`` is too small: a block of
    high leverage has small residuals. Here the residuals of block b are multiplied by
    (I - H_bb)^-1, H_bb its part of the hat matrix. They are then those of a fit without block b
    (jackknife). The factor is at most ten. Infinite for fewer than two blocks.

    With J_b (J'J)^(-1/2) = U S V', H_bb = U S^2 U' and

        (I - H_bb)^-1 r = r + U (1 / (1 - S^2) - 1) U' r
    """
    k = s.jacobian.shape[1]
    if len(np.unique(block)) < 2:
        return np.full((k, k), np.inf)
    jac = s.jacobian * np.sqrt(s.weight)[:, None]
    inverse = scaled_inverse(jac.T @ jac)
    meat = leverage_scores(s, block, inverse)
    # A change of the parameters changes the gradient by the second derivative of the loss. That of
    # the soft L1 loss is the cube of its weight: 1 / (1 + (x / scale)^2)^(3/2).
    bread = scaled_inverse(s.jacobian.T @ (s.jacobian * s.weight[:, None]**3))
    return _infinite_where_undetermined(np.asarray(bread @ meat @ bread), s)


def leverage_scores(s: Solution, block: IntArray, inverse: FloatArray) -> FloatArray:
    """Compute the sum (k, k) of g_b g_b' of ``leverage_covariance``, with its factor.

    inverse (k, k): of the normal matrix, which may contain a prior.
    """
    k = s.jacobian.shape[1]
    labels, index = np.unique(block, return_inverse=True)
    root = np.sqrt(s.weight)
    jac = s.jacobian * root[:, None]
    residual = s.residual * root
    order = np.argsort(index, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(index[order])) + 1)
    # A square root of (J'J)^-1: half half' is the inverse. Another root would only turn V'.
    value, vector = np.linalg.eigh(inverse)
    half = vector * np.sqrt(np.maximum(value, 0.0))
    meat = np.zeros((k, k))
    for rows in parts:
        # H_bb = U S^2 U'. The leverages S^2 are between 0 and 1.
        u, size, _ = np.linalg.svd(jac[rows] @ half, full_matrices=False)
        share = np.maximum(1.0 - size**2, MIN_RESIDUAL_SHARE)
        corrected = residual[rows] + u @ ((1.0 / share - 1.0) * (u.T @ residual[rows]))
        score = jac[rows].T @ corrected
        meat += np.outer(score, score)
    # Factor of the jackknife.
    return np.asarray((len(labels) - 1) / len(labels) * meat)


def split_into_blocks(t: FloatArray, group: IntArray, length: float) -> IntArray:
    """Return the block (n,) of each sample: stretches of ``length`` [s] within one group."""
    out = np.zeros(len(t), dtype=np.int64)
    count = 0
    for label in np.unique(group):
        rows = group == label
        inside = ((t[rows] - t[rows][0]) // length).astype(np.int64)
        out[rows] = inside + count
        count += int(inside.max()) + 1
    return out


def pool_blocks(parts: Sequence[IntArray]) -> tuple[IntArray, IntArray]:
    """Number the blocks of all parts through; return part (n,) and block (n,) of each sample."""
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    inside = np.concatenate([np.unique(part, return_inverse=True)[1] for part in parts])
    return owner, np.unique(np.stack([owner, inside]), axis=1, return_inverse=True)[1].reshape(-1)


def select_blocks(owner: IntArray, fine: IntArray) -> IntArray:
    """Return the recordings ``owner`` (n,) as blocks if there are enough, else ``fine`` (n,)."""
    _, count = np.unique(owner, return_counts=True)
    enough = len(count) >= MIN_RECORDING_BLOCKS and count.max() < MAX_RECORDING_SHARE * count.sum()
    return np.asarray(owner if enough else fine, dtype=np.int64)


def enclosing_covariance(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the smallest covariance (k, k) that is at least both in every direction.

    first + V max(0, L) V' with second - first = V L V', both scaled to unit diagonal of first.
    """
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return first
    # Eigenvectors of the difference are directions in which the two can be compared one by one.
    size = np.sqrt(np.maximum(np.diag(first), 1e-300))
    unit = np.outer(size, size)
    value, vector = np.linalg.eigh((second - first) / unit)
    return np.asarray(first + (vector * np.maximum(value, 0.0)) @ vector.T * unit)


def find_undetermined(s: Solution) -> BoolArray:
    """Find parameters (k,) that can change, alone or with others, without any residual changing.

    They have a part in an eigenvector of the scaled J'WJ whose eigenvalue is null.
    """
    jac = s.jacobian * np.sqrt(s.weight)[:, None]
    size = np.linalg.norm(jac, axis=0)
    scaled = jac / np.where(size > 0.0, size, 1.0)
    strength, direction = np.linalg.eigh(scaled.T @ scaled)
    free = np.abs(direction[:, strength < NULL_EIGENVALUE]) > 1e-2
    return np.asarray(np.any(free, axis=1) | (size == 0.0))


def _infinite_where_undetermined(covariance: FloatArray, s: Solution) -> FloatArray:
    """Set the variance of undetermined parameters to infinity."""
    lost = find_undetermined(s)
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    return covariance


def scaled_inverse(matrix: FloatArray) -> FloatArray:
    """Compute the pseudo-inverse after scaling to unit diagonal, so that units have no effect."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inner = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    return np.asarray(inner / np.outer(scale, scale))


def collinearity(s: Solution) -> FloatArray:
    """Compute the share (k,) of each parameter's effect that the others cannot replace, 0..1.

    sqrt(1 / (G_ii (G^-1)_ii)) with G = J'WJ. 1: orthogonal to all others; 0.05: the others
    reproduce 95 % of its effect.
    """
    jac = s.jacobian * np.sqrt(s.weight)[:, None]
    gram = jac.T @ jac
    inverse = np.diag(scaled_inverse(gram))
    alone = np.sqrt(1.0 / np.maximum(np.diag(gram) * inverse, 1.0))
    return np.asarray(np.where(find_undetermined(s), 0.0, alone))
