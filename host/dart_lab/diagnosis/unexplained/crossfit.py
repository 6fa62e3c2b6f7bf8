"""What share of a residual a function predicts where it was not fitted, and how much is chance.

For features F (n, d), residuals y (n,), folds f and ridge a:

    b_f   = (sum_(g != f) F_g^T F_g + a I)^-1 sum_(g != f) F_g^T y_g
    share = 1 - sum_f |y_f - F_f b_f|^2 / |y|^2

With S_b = sum_(i in b) F_i^T y_i by block and b_f linear in them, the explained part is a quadratic
form of the signs s of blocks, e = s^T Q s: to turn the signs of whole blocks, which no function of
the features can follow, is a product with a small matrix where blocks are few.

    Q = sum_f 2 S_f G_f S_(not f)^T - S_(not f) G_f F_f^T F_f G_f S_(not f)^T,
    G_f = (sum_(g != f) F_g^T F_g + a I)^-1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Blocked:
    """Residuals of one kind in blocks. y (n, c): without their means; block (n,): 0 to B - 1, each
    at least once; fold (n,): what is left out together, made of whole blocks."""

    y: FloatArray
    block: IntArray
    fold: IntArray


def predicted_share(columns: FloatArray, rows: Blocked, signs: FloatArray, ridge: float
                    ) -> FloatArray:
    """1 - squared error / square of held-out residuals, (s, c), for each set of signs (s, B).

    columns (n, d). Below 0 where the function predicts worse than nothing.
    """
    order = np.argsort(rows.block, kind="stable")
    phi, y, fold = columns[order], rows.y[order], rows.fold[order]
    first = np.concatenate([[0], np.flatnonzero(np.diff(rows.block[order])) + 1])
    sums = np.stack([np.add.reduceat(phi * one[:, None], first) for one in y.T])
    parts = [(phi[fold == k].T @ phi[fold == k], fold[first] == k) for k in np.unique(fold)]
    gram = sum(a for a, _ in parts) + ridge * np.eye(phi.shape[1])
    inverse = [np.linalg.inv(gram - a) for a, _ in parts]
    explain = _by_form if _quicker(len(first), phi.shape[1], len(parts), len(signs)) else _by_fold
    explained = explain(sums, [(a, g, here) for (a, here), g in zip(parts, inverse, strict=True)],
                        signs)
    return np.asarray(explained.T / np.maximum((y**2).sum(axis=0), 1e-12))


def _quicker(blocks: int, columns: int, folds: int, turns: int) -> bool:
    """Whether Q, made once, takes fewer multiplications than every fold at every turn."""
    form = folds * (2 * blocks * columns**2 + blocks**2 * columns) + turns * blocks**2
    return form < turns * (2 * folds * columns**2 + blocks * columns)


Fold = tuple[FloatArray, FloatArray, BoolArray]
"""F_f^T F_f and G_f (d, d), blocks of the fold (B,)."""


def _by_form(sums: FloatArray, folds: Sequence[Fold], signs: FloatArray) -> FloatArray:
    """e (c, s) of sums S (c, B, d) by the form Q."""
    forms = np.zeros((len(sums), sums.shape[1], sums.shape[1]))
    for a, g, here in folds:
        beta = (sums * ~here[:, None]) @ g
        forms += (2.0 * sums * here[:, None] - beta @ a) @ beta.swapaxes(1, 2)
    return np.asarray(((signs @ forms) * signs).sum(axis=2))


def _by_fold(sums: FloatArray, folds: Sequence[Fold], signs: FloatArray) -> FloatArray:
    """The same fold by fold, without Q; signs run along rows, so that sums over d are of rows."""
    turned = [sums[:, here].swapaxes(1, 2) @ np.ascontiguousarray(signs[:, here].T)
              for *_, here in folds]
    whole, explained = sum(turned), np.zeros((len(sums), len(signs)))
    for (a, g, _), part in zip(folds, turned, strict=True):
        beta = g @ (whole - part)
        explained += np.einsum("cds,cds->cs", beta, 2.0 * part - a @ beta)
    return explained


def held_out(columns: FloatArray, y: FloatArray, fold: IntArray, ridge: float
             ) -> FloatArray:
    """The predictions themselves (n,), each fold of y (n,) from the others."""
    out = np.empty(len(y))
    for k in np.unique(fold):
        there = fold == k
        out[there] = columns[there] @ _ridge(columns[~there], y[~there], ridge)
    return out


def fitted(columns: FloatArray, y: FloatArray, ridge: float) -> FloatArray:
    """The function (n,), fitted to all of y (n,)."""
    return np.asarray(columns @ _ridge(columns, y, ridge))


def _ridge(columns: FloatArray, y: FloatArray, ridge: float) -> FloatArray:
    gram = columns.T @ columns + ridge * np.eye(columns.shape[1])
    return np.asarray(np.linalg.solve(gram, columns.T @ y))


def normal_scores(share: FloatArray) -> FloatArray:
    """Shares (s, k) as standard normal numbers, column by column, each by all others of it.

    A share is a sum of few squares and has a long tail, the longer the fewer;
    the Wilson-Hilferty root of a shifted gamma distribution with the same mean,
    variance and skewness makes columns comparable. No row is treated apart, so
    what is found competes with chance on equal terms, and none hides itself.
    """
    x = share - share.mean(axis=0)
    square = x * x  # for x**3 numpy asks for a power, which takes twenty times as long
    first, second, third = ((np.sum(y, axis=0) - y) / (len(x) - 1)
                            for y in (x, square, square * x))
    variance = np.maximum(second - first**2, 1e-18)
    third = third - 3.0 * first * second + 2.0 * first**3
    skew = np.clip(third / variance**1.5, 0.05, 2.8)
    z = (x - first) / np.sqrt(variance)
    return np.asarray(6.0 / skew * (np.cbrt(1.0 + 0.5 * skew * z) - 1.0) + skew / 6.0)
