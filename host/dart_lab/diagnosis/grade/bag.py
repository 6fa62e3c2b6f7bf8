"""How sure a name is: does the effect lower the loss on data left out of its fit?

Around the last fit everything is linear. For a draw of units (recordings, or stretches of one) with
counts c_u, the bag, the units u that were not drawn judge:

    L_u(x) = L_u + 2 h_u^T x + x^T H_u x,   h_u = Z_u^T Omega r_u,  H_u = Z_u^T Omega Z_u
    x_with    = argmin sum_u c_u L_u(x) + |x0 + x|^2_P           Z: all that is free, and d_a
    x_without = the same with the step along d_a held at -1
    P(a) = share of draws with sum_(c_u = 0) (L_u(x_without) - L_u(x_with)) > 0

A cause may be written a little differently in the car than in the catalogue: each effect f that
gained more than a has columns beside it with a prior of one standard deviation each: phi_j d_f, its
size changed by functions of the state, and the other ways to write a force (family). What the
family of the first explains is no second cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_lab.identification.evaluation.compare import draws as drawn

from ..policy import TAIL, GradePolicy
from .secants import Secants, modulations

ABSENT = -1.0  # step along a secant at which its effect is gone


@dataclass(frozen=True, slots=True)
class Problem:
    """Normal matrices H (u, k, k) and slopes h (u, k) by unit, prior pull (k,) and where it is
    from, x0 (k,); the last coordinate is the step along the secant."""

    normal: FloatArray
    slope: FloatArray
    pull: FloatArray
    start: FloatArray


def grades(of: Secants, names: Sequence[str], policy: GradePolicy, seed: int) -> dict[str, float]:
    """P of each named effect, given with the largest gain first."""
    every = _every(of, names, policy)
    return {name: probability(_problem(of, every, name, names[:i]), ABSENT, policy.draws, seed)
            for i, name in enumerate(names)}


def probability(problem: Problem, absent: float, draws: int, seed: int) -> float:
    """Share of draws in which the units left out are better told with the effect than without.

    With the normal matrix in blocks, (A b; b^T c), and slopes (s, t): all else follows a step z
    along the secant by -A^-1 s - z A^-1 b, and the best z is -(t - b^T A^-1 s) / (c - b^T A^-1 b).
    """
    units = len(problem.normal)
    counts = drawn(np.arange(units), draws, seed)
    out = (counts == 0.0).astype(np.float64)
    keep = out.sum(axis=1) > 0.0
    counts, out = counts[keep], out[keep]
    normal = np.tensordot(counts, problem.normal, 1) + np.diag(problem.pull + 1e-9)
    slope = counts @ problem.slope + problem.pull * problem.start
    beside, own = normal[:, :-1, -1], normal[:, -1, -1]
    rest, along = np.moveaxis(np.linalg.solve(
        normal[:, :-1, :-1], np.stack([slope[:, :-1], beside], axis=2)), 2, 0)
    best = -((slope[:, -1] - (beside * rest).sum(axis=1))
             / (own - (beside * along).sum(axis=1)))
    with_it, without = (np.column_stack([-rest - z[:, None] * along, z]) for z in (
        np.where(best < absent, np.nan, best), np.full(len(best), absent)))
    judge_normal, judge_slope = np.tensordot(out, problem.normal, 1), out @ problem.slope

    def loss(x: FloatArray) -> FloatArray:
        curved = (judge_normal @ x[..., None])[..., 0]
        return np.asarray((x * (2.0 * judge_slope + curved)).sum(axis=1))

    return float(np.mean(loss(with_it) < loss(without)))  # NaN, an effect of the wrong sign: False


def sizes(of: Secants, name: str) -> tuple[tuple[float, float], ...]:
    """By recording, the size of an effect that its data alone ask for, relative to the fitted one.

    a_r = 1 - sum_r w d r / sum_r w d^2, d the secant with all else projected out; its standard
    error from the scores of blocks.
    """
    point, rows = of.point, of.rows
    d = point.projection(of.coordinates[name])(of.tangent[name])
    w = point.irls_weight
    score = np.bincount(rows.block, w * d * point.residual)
    of_block = np.zeros(len(score), dtype=np.int64)
    of_block[rows.block] = rows.recording
    recordings = int(rows.recording.max()) + 1
    known = np.bincount(rows.recording, w * d**2, recordings)
    pulls = np.bincount(of_block, score, recordings)
    spread = np.sqrt(np.bincount(of_block, score**2, recordings))
    known = np.maximum(known, 1e-12)
    return tuple((float(1.0 - p / k), float(s / k))
                 for p, s, k in zip(pulls, spread, known, strict=True))


@dataclass(frozen=True, slots=True)
class _Every:
    """H (u, k, k), h (u, k) and prior pull (k,) of all columns that any problem has.

    family, secant: by effect, where its columns are.
    """

    normal: FloatArray
    slope: FloatArray
    pull: FloatArray
    family: Mapping[str, IntArray]
    secant: Mapping[str, int]


def _every(of: Secants, names: Sequence[str], policy: GradePolicy) -> _Every:
    """All that is free, the families of all but the last, and the secants."""
    point = of.point
    states = policy.family * (modulations(of, TAIL) if names[1:] else np.zeros((1, 0)))
    parts, family, k = [point.jacobian], dict[str, IntArray](), len(point.x)
    for name in names[:-1]:
        parts += [of.variants[name], of.of[name][:, None] * states]
        family[name] = np.arange(k, k + parts[-2].shape[1] + parts[-1].shape[1])
        k += len(family[name])
    parts += [of.of[name][:, None] for name in names]
    root = np.sqrt(point.irls_weight)
    columns = np.concatenate(parts, axis=1) * root[:, None]
    residual = root * point.residual
    inside = [columns[here] for here in (of.unit == u for u in range(int(of.unit.max()) + 1))]
    pull = np.concatenate([point.space.prior_weight, np.ones(k - len(point.x)),
                           np.zeros(len(names))])
    return _Every(np.stack([x.T @ x for x in inside]),
                  np.stack([x.T @ residual[of.unit == u] for u, x in enumerate(inside)]),
                  pull, family, {name: k + i for i, name in enumerate(names)})


def _problem(of: Secants, every: _Every, name: str, above: Sequence[str]) -> Problem:
    """Of one effect; above: named effects that gained more."""
    x = of.point.x
    free = np.setdiff1d(np.arange(len(x)), of.coordinates[name])
    at = np.concatenate([free, *(every.family[f] for f in above), [every.secant[name]]])
    start = np.zeros(len(at))
    start[:len(free)] = x[free]
    return Problem(every.normal[:, at[:, None], at], every.slope[:, at], every.pull[at], start)
