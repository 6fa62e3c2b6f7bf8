"""Cross-validated share of the variance that a function explains, and its null distribution.

For features F (n, d), residuals y (n,), folds f and ridge a:

    b_f   = (sum_(g != f) F_g^T F_g + a I)^-1 sum_(g != f) F_g^T y_g
    share = 1 - sum_f |y_f - F_f b_f|^2 / |y|^2

The null distribution comes from flipping the signs of whole blocks, which no function of the
features can follow. With S_b = sum_(i in b) F_i^T y_i by block and b_f linear in them, the
explained part is a quadratic form of the signs s, e = s^T Q s. With few blocks, each flip is a
product with a small matrix.

    Q = sum_f 2 S_f G_f S_(not f)^T - S_(not f) G_f F_f^T F_f G_f S_(not f)^T,
    G_f = (sum_(g != f) F_g^T F_g + a I)^-1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray

RIDGE = 10.0  # of residuals of size 1: structure of a tenth of the variance
FOLDS = 8  # of blocks: 7 of 8 to fit
MIN_SIGN_BLOCKS = 10  # 2^10 ways to turn signs: enough for a level of 1 %


@dataclass(frozen=True, slots=True)
class BlockedResiduals:
    """Residuals of one kind in blocks.

    y (n, c): without their means. block (n,): 0 to B - 1, each at least once. fold (n,): test fold,
    made of whole blocks.
    """

    y: FloatArray
    block: IntArray
    fold: IntArray


def predicted_share(columns: FloatArray, rows: BlockedResiduals, signs: FloatArray) -> FloatArray:
    """Explained share of the variance on the test folds, (s, c), for each set of signs (s, B).

    columns (n, d): basis functions. Negative if the function predicts worse than zero.
    """
    order = np.argsort(rows.block, kind="stable")
    phi = columns[order]
    y = rows.y[order]
    fold = rows.fold[order]
    # S by channel: sums of phi y over each block, with rows sorted by block.
    first = np.concatenate([[0], np.flatnonzero(np.diff(rows.block[order])) + 1])
    sums = np.stack([np.add.reduceat(phi * one[:, None], first) for one in y.T])
    parts = [(phi[fold == k].T @ phi[fold == k], fold[first] == k) for k in np.unique(fold)]
    # G by fold: the Gram matrix without the fold.
    gram = sum(a for a, _ in parts) + RIDGE * np.eye(phi.shape[1])
    inverse = [np.linalg.inv(gram - a) for a, _ in parts]
    explain = _by_form if _is_form_faster(len(first), phi.shape[1], len(parts),
                                          len(signs)) else _by_fold
    explained = explain(sums, [(a, g, here) for (a, here), g in zip(parts, inverse, strict=True)],
                        signs)
    return np.asarray(explained.T / np.maximum((y**2).sum(axis=0), 1e-12))


def _is_form_faster(blocks: int, columns: int, folds: int, flips: int) -> bool:
    """Compare the multiplications of form Q (computed once) and of every fold at every flip."""
    form = folds * (2 * blocks * columns**2 + blocks**2 * columns) + flips * blocks**2
    return form < flips * (2 * folds * columns**2 + blocks * columns)


# F_f^T F_f and G_f (d, d), blocks of the fold (B,).
Fold = tuple[FloatArray, FloatArray, BoolArray]


def _by_form(sums: FloatArray, folds: Sequence[Fold], signs: FloatArray) -> FloatArray:
    """Explained part e (c, s) for sums S (c, B, d), by the form Q."""
    forms = np.zeros((len(sums), sums.shape[1], sums.shape[1]))
    for a, g, here in folds:
        beta = (sums * ~here[:, None]) @ g
        forms += (2.0 * sums * here[:, None] - beta @ a) @ beta.swapaxes(1, 2)
    return np.asarray(((signs @ forms) * signs).sum(axis=2))


def _by_fold(sums: FloatArray, folds: Sequence[Fold], signs: FloatArray) -> FloatArray:
    """Explained part e (c, s) for sums S (c, B, d), fold by fold without Q.

    Signs vary along rows, so that the sums over d are over contiguous rows.
    """
    flipped = [sums[:, here].swapaxes(1, 2) @ np.ascontiguousarray(signs[:, here].T)
              for *_, here in folds]
    whole = sum(flipped)
    explained = np.zeros((len(sums), len(signs)))
    for (a, g, _), part in zip(folds, flipped, strict=True):
        beta = g @ (whole - part)
        explained += np.einsum("cds,cds->cs", beta, 2.0 * part - a @ beta)
    return explained


def predict_held_out(columns: FloatArray, y: FloatArray, fold: IntArray) -> FloatArray:
    """Predict y (n,) on each fold from the other folds, (n,)."""
    out = np.empty(len(y))
    for k in np.unique(fold):
        test = fold == k
        out[test] = columns[test] @ _ridge(columns[~test], y[~test])
    return out


def fit_function(columns: FloatArray, y: FloatArray) -> FloatArray:
    """Fit a function to all of y (n,), and return its values (n,)."""
    return np.asarray(columns @ _ridge(columns, y))


def _ridge(columns: FloatArray, y: FloatArray) -> FloatArray:
    """Coefficients (d,) of a ridge regression."""
    gram = columns.T @ columns + RIDGE * np.eye(columns.shape[1])
    return np.asarray(np.linalg.solve(gram, columns.T @ y))


def normal_scores(share: FloatArray) -> FloatArray:
    """Convert shares (s, k) to standard normal scores, column by column.

    A share is a sum of few squares with a long tail. Each value is compared with all other rows of
    its column: the Wilson-Hilferty root of a shifted gamma distribution with the same mean,
    variance and skewness makes columns comparable. All rows are treated equally: the observed row
    competes with the null rows on equal terms, and no row influences its own score.
    """
    x = share - share.mean(axis=0)
    square = x * x  # x**3 is a power in NumPy, twenty times slower
    first, second, third = ((np.sum(y, axis=0) - y) / (len(x) - 1)
                            for y in (x, square, square * x))
    variance = np.maximum(second - first**2, 1e-18)
    third = third - 3.0 * first * second + 2.0 * first**3
    skew = np.clip(third / variance**1.5, 0.05, 2.8)
    z = (x - first) / np.sqrt(variance)
    return np.asarray(6.0 / skew * (np.cbrt(1.0 + 0.5 * skew * z) - 1.0) + skew / 6.0)
