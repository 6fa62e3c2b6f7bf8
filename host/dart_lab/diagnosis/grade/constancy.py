"""Test whether a cause has the same size throughout, or changes with something.

    s_kb = sum_(i in b) w_i phi_k(z_i) d_i r_i,   phi_k centred by the information w d^2
    T    = max_k |sum_b s_kb| / sqrt(sum_b s_kb^2)

d: tangent of the cause; every phi_k d has all free parameters projected out. z: speed, angle,
throttle, accelerations, time, place, heading. The null distribution of T follows from random signs
of the blocks: wind that resembles a slope has its period in time, warming tyres have a trend. The
variables with a significant T are listed, the most likely first. The change is

    a = |sum_b s_kb| / sum w (P phi_k d)^2      as a share of the size, with phi of unit size
"""

from __future__ import annotations

import numpy as np

from dart_lab.identification.evidence.policy import MANY_RECORDINGS

from ..policy import GradePolicy
from ..result import Constancy
from ..search.significance import p_value
from .secants import Secants, size_functions

SIGN_DRAWS = 999  # signs of blocks turned: ten of them beyond the level of a change
MIN_SCORE = 1e-9  # below, a function has no values in this driving


def assess_constancy(linear: Secants, name: str, policy: GradePolicy, seed: int) -> Constancy:
    """Test the size of one effect; without an effect on the residuals no change is possible.

    1. Project the tangent times each function phi_k, and sum the scores by block or recording.
    2. Compare each function with the maximum over all functions under random signs.
    3. Report the most significant variable, and others that are significant.
    """
    point = linear.point
    w = point.irls_weight
    d = linear.tangent[name]
    project = point.projection(linear.coordinates[name])
    names, phi = size_functions(linear)
    # 1. phi_k minus its mean, weighted by the information about the size: the mean change is the
    #    size itself, which is fitted already.
    information = w * project(d)**2
    phi = phi - (information @ phi) / max(float(information.sum()), 1e-12)
    changed = project(d[:, None] * phi)
    score = changed * (w * point.residual)[:, None]
    # 2. Sums over units that are independent: recordings if there are enough, else blocks of time.
    unit = linear.rows.recording
    if int(unit.max()) + 1 < MANY_RECORDINGS:
        unit = linear.rows.block
    blocks = np.stack([np.bincount(unit, column) for column in score.T], axis=1)
    size = np.sqrt((blocks**2).sum(axis=0))
    use = size > MIN_SCORE
    if not use.any():
        return Constancy(1.0, "", (), 0.0, (policy.change_level, policy.min_change))
    blocks = blocks[:, use]
    size = size[use]
    # Newton step of the coefficient of phi_k: score over information.
    change = -blocks.sum(axis=0) / np.maximum((w @ changed**2)[use], 1e-12)
    names = [n for n, u in zip(names, use, strict=True) if u]
    # 3. Without a change the sums are symmetric about 0, so random signs give equally likely data.
    #    The maximum over all functions makes the p-value family-wise.
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (SIGN_DRAWS, len(blocks)))
    null = np.sort((np.abs(signs @ blocks) / size).max(axis=1))
    statistic = np.abs(blocks.sum(axis=0)) / size
    best = int(statistic.argmax())
    p = [p_value(float(f), null) for f in statistic]
    likely = [names[i] for i in np.argsort(-statistic) if p[i] < policy.change_level]
    others = [n for n in dict.fromkeys(likely) if n != names[best]]
    return Constancy(p[best], names[best], _curve(linear, name, names[best]),
                     abs(float(change[best])), (policy.change_level, policy.min_change),
                     tuple(others[:2]))


def _curve(linear: Secants, name: str, variable: str, bins: int = 6
           ) -> tuple[tuple[float, float, float], ...]:
    """Return (variable, relative size, standard error) in bins with the same information each."""
    point = linear.point
    w = point.irls_weight
    d = point.projection(linear.coordinates[name])(linear.tangent[name])
    information = w * d**2
    value = linear.features[variable]
    # Bins along the variable, of equal information: their standard errors are then similar.
    order = np.argsort(value, kind="stable")
    share = np.cumsum(information[order]) / max(float(information.sum()), 1e-12)
    bin_of = np.empty(len(value), dtype=np.int64)
    bin_of[order] = np.minimum((share * bins).astype(np.int64), bins - 1)
    out = []
    for k in range(bins):
        inside = bin_of == k
        total = max(float(information[inside].sum()), 1e-12)
        scores = np.bincount(linear.rows.block[inside], (w * d * point.residual)[inside])
        out.append((float((information[inside] @ value[inside]) / total),
                    float(1.0 - scores.sum() / total), float(np.sqrt(scores @ scores) / total)))
    return tuple(out)
