"""Whether a cause has the same size throughout, or changes with something.

    s_kb = sum_(i in b) w_i phi_k(z_i) d_i r_i,   phi_k centred by the information w d^2
    T    = max_k |sum_b s_kb| / sqrt(sum_b s_kb^2)

d: tangent of the cause, every phi_k d with all that is free projected out; z: speed, angle,
throttle, accelerations, time, place, heading. The null distribution of T turns the signs of blocks:
a wind named as a slope has its period in time, warming tyres a course. Other variables along which
a constant size would not vary so either are listed, most likely first. How much it changes is

    a = |sum_b s_kb| / sum w (P phi_k d)^2      as a share of its size, phi of unit size
"""

from __future__ import annotations

import numpy as np

from ..policy import MANY_RECORDINGS, GradePolicy
from ..result import Constancy
from ..search.significance import p_value
from .secants import Secants, shapes


def constancy(of: Secants, name: str, policy: GradePolicy, seed: int) -> Constancy:
    """Of one named effect; of one that does nothing there is no size that could change."""
    point, w = of.point, of.point.irls_weight
    d, project = of.tangent[name], of.point.projection(of.coordinates[name])
    names, phi = shapes(of, policy)
    known = w * project(d)**2
    phi = phi - (known @ phi) / max(float(known.sum()), 1e-12)
    along = project(d[:, None] * phi)
    score = along * (w * point.residual)[:, None]
    unit = of.rows.recording
    if int(unit.max()) + 1 < MANY_RECORDINGS:
        unit = of.rows.block
    blocks = np.stack([np.bincount(unit, column) for column in score.T], axis=1)
    size = np.sqrt((blocks**2).sum(axis=0))
    use = size > 1e-9
    if not use.any():
        return Constancy(1.0, "", (), 0.0, (policy.changes, policy.least_change))
    blocks, size = blocks[:, use], size[use]
    change = -blocks.sum(axis=0) / np.maximum((w @ along**2)[use], 1e-12)
    names = [n for n, u in zip(names, use, strict=True) if u]
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (policy.turns, len(blocks)))
    null = np.sort((np.abs(signs @ blocks) / size).max(axis=1))
    found = np.abs(blocks.sum(axis=0)) / size
    best = int(found.argmax())
    p = [p_value(float(f), null) for f in found]
    likely = [names[i] for i in np.argsort(-found) if p[i] < policy.changes]
    others = [n for n in dict.fromkeys(likely) if n != names[best]]
    return Constancy(p[best], names[best], _curve(of, name, names[best]), abs(float(change[best])),
                     (policy.changes, policy.least_change), tuple(others[:2]))


def _curve(of: Secants, name: str, along: str, bins: int = 6
           ) -> tuple[tuple[float, float, float], ...]:
    """(place, relative size, standard error) in bins with the same information each."""
    point, w = of.point, of.point.irls_weight
    d = point.projection(of.coordinates[name])(of.tangent[name])
    known, value = w * d**2, of.features[along]
    order = np.argsort(value, kind="stable")
    share = np.cumsum(known[order]) / max(float(known.sum()), 1e-12)
    which = np.empty(len(value), dtype=np.int64)
    which[order] = np.minimum((share * bins).astype(np.int64), bins - 1)
    out = []
    for k in range(bins):
        here = which == k
        info = max(float(known[here].sum()), 1e-12)
        scores = np.bincount(of.rows.block[here], (w * d * point.residual)[here])
        out.append((float((known[here] @ value[here]) / info), float(1.0 - scores.sum() / info),
                    float(np.sqrt(scores @ scores) / info)))
    return tuple(out)
