"""Grade effects: does an effect lower the loss on data held out of its fit?

Around the last fit everything is linear. Units (recordings, or stretches of one) are drawn with
replacement, with counts c_u. The units that were not drawn judge a fit to those that were:

    L_u(x) = L_u + 2 h_u^T x + x^T H_u x,   h_u = Z_u^T Omega r_u,  H_u = Z_u^T Omega Z_u
    x_with    = argmin sum_u c_u L_u(x) + (x0 + x)^T R (x0 + x)
    x_without = the same with the step along the secant d_a fixed at -1
    P(a) = share of draws with sum_(c_u = 0) (L_u(x_without) - L_u(x_with)) > 0

x: change of the coordinates from the last fit x0, with the precision R of their prior; its last
element is the step along d_a. r_u, Z_u, Omega_u: residuals of a unit, their derivatives by x, and
weights.

The equation of a cause in the car may differ a little from that of the catalogue. Each effect f
with a larger gain than a therefore has additional columns, with a prior of one standard deviation
each: phi_j d_f, its size changed by functions of the state, and the other ways to write a force
(``family``). What these explain is no second cause. Nor is what the parameters explain that keep
the values of the file, within the errors stated there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_lab.identification.evaluation.compare import draw_blocks as drawn

from ..policy import TAIL
from .family import STATE_WIDTH
from .secants import Secants, state_modulations

BOOTSTRAP_DRAWS = 400  # draws of units; P = 0.97 is known to 0.01
ABSENT_STEP = -1.0  # step along a secant at which its effect is removed


@dataclass(frozen=True, slots=True)
class BootstrapProblem:
    """A linear fit whose last coordinate is the step along the secant.

    normal (u, k, k) and slope (u, k): H and h by unit; prior (k, k): R; start (k,): x0.
    """

    normal: FloatArray
    slope: FloatArray
    prior: FloatArray
    start: FloatArray


def grade_effects(linear: Secants, names: Sequence[str], seed: int) -> dict[str, float]:
    """Compute P of each effect, given with the largest gain first."""
    columns = _stack_columns(linear, names)
    return {name: probability(_select_columns(linear, columns, name, names[:i]), ABSENT_STEP,
                              BOOTSTRAP_DRAWS, seed)
            for i, name in enumerate(names)}


def probability(problem: BootstrapProblem, absent: float, draws: int, seed: int) -> float:
    """Compute the share of draws in which held-out units are predicted better with the effect.

    With the normal matrix in blocks, (A b; b^T c), and slopes (s, t): the other coordinates follow
    a step z along the secant by -A^-1 s - z A^-1 b, and the best z is
    -(t - b^T A^-1 s) / (c - b^T A^-1 b).
    """
    units = len(problem.normal)
    # 1. Draw units. Those that were not drawn, a third on average, judge; a draw without any is
    #    dropped.
    counts = drawn(np.arange(units), draws, seed)
    held_out = (counts == 0.0).astype(np.float64)
    keep = held_out.sum(axis=1) > 0.0
    counts = counts[keep]
    held_out = held_out[keep]
    # 2. Sums over the drawn units, and the prior: (A b; b^T c) and (s, t).
    normal = (np.tensordot(counts, problem.normal, 1) + problem.prior
              + 1e-9 * np.eye(len(problem.start)))
    slope = counts @ problem.slope + problem.prior @ problem.start
    b = normal[:, :-1, -1]
    c = normal[:, -1, -1]
    # 3. Eliminate all coordinates but z, for all draws at once; the best z is a quotient of
    #    scalars.
    a_inv_s, a_inv_b = np.moveaxis(np.linalg.solve(
        normal[:, :-1, :-1], np.stack([slope[:, :-1], b], axis=2)), 2, 0)
    best = -((slope[:, -1] - (b * a_inv_s).sum(axis=1))
             / (c - (b * a_inv_b).sum(axis=1)))
    with_it, without = (np.column_stack([-a_inv_s - z[:, None] * a_inv_b, z]) for z in (
        np.where(best < absent, np.nan, best), np.full(len(best), absent)))
    # 4. Loss of both solutions on the held-out units. A size beyond -1 would reverse the sign of
    #    the effect.
    judge_normal = np.tensordot(held_out, problem.normal, 1)
    judge_slope = held_out @ problem.slope

    def loss(x: FloatArray) -> FloatArray:
        curved = (judge_normal @ x[..., None])[..., 0]
        return np.asarray((x * (2.0 * judge_slope + curved)).sum(axis=1))

    # An effect of the wrong sign has a loss of NaN, which is not smaller.
    return float(np.mean(loss(with_it) < loss(without)))


def estimate_sizes_by_recording(linear: Secants, name: str) -> tuple[tuple[float, float], ...]:
    """Estimate the size of an effect in each recording, relative to the fitted one.

        a_j = 1 - sum_(i in j) w_i d_i r_i / sum_(i in j) w_i d_i^2       in recording j

    with w the weights of the rows i, r their residuals, and d the tangent of the effect with all
    other parameters projected out. The standard error follows from the scores of blocks.
    """
    point = linear.point
    rows = linear.rows
    # With the other parameters projected out, the loss of a recording is a parabola over the size
    # alone; a_j is its minimum.
    d = point.projection(linear.coordinates[name])(linear.tangent[name])
    w = point.irls_weight
    score = np.bincount(rows.block, w * d * point.residual)
    of_block = np.zeros(len(score), dtype=np.int64)
    of_block[rows.block] = rows.recording
    recordings = int(rows.recording.max()) + 1
    information = np.bincount(rows.recording, w * d**2, recordings)
    scores = np.bincount(of_block, score, recordings)
    spread = np.sqrt(np.bincount(of_block, score**2, recordings))
    information = np.maximum(information, 1e-12)
    return tuple((float(1.0 - p / k), float(s / k))
                 for p, s, k in zip(scores, spread, information, strict=True))


@dataclass(frozen=True, slots=True)
class _Columns:
    """H (u, k, k), h (u, k) and prior precision (k, k) of the columns of all problems.

    family, secant: by effect, the indices of its columns. stated: those of ``Secants.stated``.
    """

    normal: FloatArray
    slope: FloatArray
    prior: FloatArray
    family: Mapping[str, IntArray]
    secant: Mapping[str, int]
    stated: IntArray


def _stack_columns(linear: Secants, names: Sequence[str]) -> _Columns:
    """Stack free parameters, those of the file, columns of all effects but the last, and secants.

    No effect has a smaller gain than the last one, so its additional columns are not needed.
    """
    point = linear.point
    states = STATE_WIDTH * (state_modulations(linear, TAIL) if names[1:] else np.zeros((1, 0)))
    parts = [point.jacobian, linear.stated.jacobian]
    family = dict[str, IntArray]()
    n = len(point.x)
    k = n + len(linear.stated.precision)
    stated = np.arange(n, k)
    for name in names[:-1]:
        parts += [linear.variants[name], linear.secant[name][:, None] * states]
        family[name] = np.arange(k, k + parts[-2].shape[1] + parts[-1].shape[1])
        k += len(family[name])
    parts += [linear.secant[name][:, None] for name in names]
    root = np.sqrt(point.irls_weight)
    columns = np.concatenate(parts, axis=1) * root[:, None]
    residual = root * point.residual
    unit = linear.unit
    by_unit = [columns[rows] for rows in (unit == u for u in range(int(unit.max()) + 1))]
    prior = np.diag(np.concatenate([np.ones(k), np.zeros(len(names))]))
    prior[:n, :n] = point.space.prior_precision
    prior[np.ix_(stated, stated)] = linear.stated.precision
    return _Columns(np.stack([x.T @ x for x in by_unit]),
                    np.stack([x.T @ residual[unit == u] for u, x in enumerate(by_unit)]),
                    prior, family, {name: k + i for i, name in enumerate(names)}, stated)


def _select_columns(linear: Secants, columns: _Columns, name: str, larger: Sequence[str]
                    ) -> BootstrapProblem:
    """Select the problem of one effect; larger: effects with a larger gain."""
    x = linear.point.x
    free = np.setdiff1d(np.arange(len(x)), linear.coordinates[name])
    index = np.concatenate([free, columns.stated, *(columns.family[f] for f in larger),
                            [columns.secant[name]]])
    start = np.zeros(len(index))
    start[:len(free)] = x[free]
    return BootstrapProblem(columns.normal[:, index[:, None], index], columns.slope[:, index],
                            columns.prior[np.ix_(index, index)], start)
