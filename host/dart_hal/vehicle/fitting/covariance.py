"""Covariances of a fit that respect autocorrelation, and what the data leave undetermined.

Samples of a drive are not independent: what disturbs the car now disturbs it
a quarter of a second later too. Errors that count samples are several times
too small; here they come from blocks (whole recordings, or stretches of some
seconds) that are taken as independent, however their inside is correlated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.fitting.least_squares import Solution

LEAST_FREE = 0.1
"""Share of a residual that a block cannot have pulled away, however alone it is."""
RECORDINGS = 8
"""From which on a recording is a block: with fewer a sandwich over them has no degrees left."""
LARGEST_SHARE = 0.35
"""Of all samples in one recording; with more the others are no comparison."""
NULL = 1e-11
"""Eigenvalue of the scaled normal matrix (about 1) below which a direction is undetermined."""


def plain_covariance(s: Solution) -> FloatArray:
    """Covariance (k, k) that takes the residuals as independent, as the paper's would."""
    n, k = s.jacobian.shape
    variance = float(s.residual @ s.residual) / max(n - k, 1)
    return _infinite_where_undetermined(variance * scaled_inverse(s.jacobian.T @ s.jacobian), s)


def block_covariance(s: Solution, block: IntArray, prior: float | FloatArray = 0.0, *,
                     count_parameters: bool = False) -> FloatArray:
    """Covariance (k, k) by the sandwich over independent blocks (n,) of samples.

    H^-1 (sum over blocks of g g') H^-1 with g the block's gradient and the
    small-sample factor B / (B - 1). With fewer than two blocks: infinite.
    prior: weight of a prior |x|^2 of unit variance in the sum of squares, one
    or of each parameter (k,); what the data do not tell then keeps variance 1.
    count_parameters: the factor is B / (B - p), with p the number of parameters
    that the data determine, trace(H^-1 J'WJ): a fit of p parameters leaves its
    blocks smaller gradients than they would have at the truth.
    """
    k = s.jacobian.shape[1]
    weighted = s.jacobian * s.weight[:, None]
    normal = weighted.T @ s.jacobian
    hessian = scaled_inverse(normal + prior * np.eye(k))
    labels, index = np.unique(block, return_inverse=True)
    if len(labels) < 2:
        return np.full((k, k), np.inf)
    gradient = np.zeros((len(labels), k))
    np.add.at(gradient, index, weighted * s.residual[:, None])
    gradient -= gradient.mean(axis=0)  # with a prior the data's own slope is not zero
    blocks = len(labels)
    determined = float(np.trace(hessian @ normal)) if count_parameters else 1.0
    free = max(blocks - max(determined, 1.0), LEAST_FREE * blocks)
    meat = gradient.T @ gradient * blocks / free + prior**2 * np.eye(k)
    covariance = np.asarray(hessian @ meat @ hessian)
    return covariance if np.any(prior) else _infinite_where_undetermined(covariance, s)


def held_covariance(s: Solution, columns: FloatArray, prior: float = 0.0) -> FloatArray:
    """Covariance (k, k) by quantities that a fit holds at measured values.

    An error of one standard error of a held quantity changes the residuals by a column (n, h), and
    so the parameters by -H^-1 J' W column: these add up, as the errors are independent. prior: as
    ``block_covariance``.
    """
    weighted = s.jacobian * s.weight[:, None]
    hessian = weighted.T @ s.jacobian + prior * np.eye(s.jacobian.shape[1])
    shift = scaled_inverse(hessian) @ (weighted.T @ columns)
    return np.asarray(shift @ shift.T)


def leverage_covariance(s: Solution, block: IntArray) -> FloatArray:
    """Covariance (k, k) by the sandwich with residuals corrected for the pull of their block.

    With few blocks, or where a few of them carry the fit, ``block_covariance``
    is too small: a block that pulls the fit to itself has small residuals. Here
    each block's residuals are multiplied by (I - H_bb)^-1, H_bb its part of the
    hat matrix: what they would be had the fit not seen that block (the
    jackknife, "CR3" of Bell and McCaffrey), at most tenfold. With fewer than
    two blocks: infinite.
    """
    k = s.jacobian.shape[1]
    labels = np.unique(block)
    if len(labels) < 2:
        return np.full((k, k), np.inf)
    root = np.sqrt(s.weight)
    jac, left = s.jacobian * root[:, None], s.residual * root
    inverse = scaled_inverse(jac.T @ jac)
    value, vector = np.linalg.eigh(inverse)
    half = vector * np.sqrt(np.maximum(value, 0.0))
    meat = np.zeros((k, k))
    for label in labels:
        rows = block == label
        u, size, _ = np.linalg.svd(jac[rows] @ half, full_matrices=False)
        pull = np.maximum(1.0 - size**2, LEAST_FREE)
        corrected = left[rows] + u @ ((1.0 / pull - 1.0) * (u.T @ left[rows]))
        score = jac[rows].T @ corrected
        meat += np.outer(score, score)
    share = (len(labels) - 1) / len(labels)
    return _infinite_where_undetermined(np.asarray(share * inverse @ meat @ inverse), s)


def blocks_of(t: FloatArray, group: IntArray, length: float) -> IntArray:
    """Block (n,) of each sample: stretches of ``length`` [s], never across groups."""
    out = np.zeros(len(t), dtype=np.int64)
    count = 0
    for label in np.unique(group):
        rows = group == label
        inside = ((t[rows] - t[rows][0]) // length).astype(np.int64)
        out[rows] = inside + count
        count += int(inside.max()) + 1
    return out


def pooled_blocks(parts: Sequence[IntArray]) -> tuple[IntArray, IntArray]:
    """(part (n,) of each sample, block (n,) of each): the blocks of all parts, kept apart."""
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    inside = np.concatenate([np.unique(part, return_inverse=True)[1] for part in parts])
    return owner, np.unique(np.stack([owner, inside]), axis=1, return_inverse=True)[1].reshape(-1)


def independent_blocks(owner: IntArray, fine: IntArray) -> IntArray:
    """owner (n,): recording of each sample, if there are 8 and none holds most; else fine (n,)."""
    _, count = np.unique(owner, return_counts=True)
    enough = len(count) >= RECORDINGS and count.max() < LARGEST_SHARE * count.sum()
    return np.asarray(owner if enough else fine, dtype=np.int64)


def wider(first: FloatArray, second: FloatArray) -> FloatArray:
    """The smallest covariance (k, k) that in no direction is narrower than either."""
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return first
    size = np.sqrt(np.maximum(np.diag(first), 1e-300))
    unit = np.outer(size, size)
    value, vector = np.linalg.eigh((second - first) / unit)
    return np.asarray(first + (vector * np.maximum(value, 0.0)) @ vector.T * unit)


def undetermined(s: Solution) -> BoolArray:
    """Parameters (k,) that can be changed, alone or with others, without changing any residual."""
    jac = s.jacobian * np.sqrt(s.weight)[:, None]
    size = np.linalg.norm(jac, axis=0)
    scaled = jac / np.where(size > 0.0, size, 1.0)
    strength, direction = np.linalg.eigh(scaled.T @ scaled)
    free = np.abs(direction[:, strength < NULL]) > 1e-2
    return np.asarray(np.any(free, axis=1) | (size == 0.0))


def _infinite_where_undetermined(covariance: FloatArray, s: Solution) -> FloatArray:
    """The covariance with infinite variance for what no residual depends on."""
    lost = undetermined(s)
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    return covariance


def scaled_inverse(matrix: FloatArray) -> FloatArray:
    """Pseudo-inverse scaled to unit diagonal first: units must not decide the rank."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inner = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    return np.asarray(inner / np.outer(scale, scale))


def collinearity(s: Solution) -> FloatArray:
    """Share (k,) of each parameter's effect that no other parameter can take over, 0..1.

    1: on its own; 0.05: a change of it looks like a change of the others but
    for a twentieth.
    """
    jac = s.jacobian * np.sqrt(s.weight)[:, None]
    gram = jac.T @ jac
    inverse = np.diag(scaled_inverse(gram))
    alone = np.sqrt(1.0 / np.maximum(np.diag(gram) * inverse, 1.0))
    return np.asarray(np.where(undetermined(s), 0.0, alone))
