"""Causes of a search that leave as much structure as there is without them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray

from .evidence.rows import RowLabels
from .gates import Candidate, explain_failure
from .question import Question
from .result import Unexplained
from .search.fit import Point
from .search.forward import SearchResult
from .search.selection import label_point_rows
from .unexplained.structure import explained_shares, group_residuals
from .unexplained.waits import remove_frame_wait


def find_spurious(q: Question, found: SearchResult, left: Sequence[Unexplained]
                  ) -> tuple[str, ...]:
    """Causes that leave more structure, where they act, than they take away.

    And as much as there is without them: a cause may stand beside another that
    nobody knows. What differs from recording to recording says nothing of a
    cause that is the same in all.
    """
    if all("recording" in u.along for u in left):
        return ()
    policy = q.settings.policy.conclusion
    after, out = _structure(q, found, found.point), []
    names = [n.effect for n in found.accepted]
    for name in names:
        without = q.search.fit_subset(found.point, found.noise, [n for n in names if n != name],
                               found.point)
        taken = _taken(q, without, found.point)
        total = sum(max(t, 0.0) for t in taken.values())
        suspect = [u.channel for u in left if "recording" not in u.along
                   and taken.get(u.channel, 0.0) > policy.mainly * total]
        before = _structure(q, found, without) if suspect else {}
        if any(explain_failure("structure", Candidate(
                structure_after=after[c], structure_before=before[c],
                structure_removed=taken[c]), q.settings.policy) for c in suspect):
            out.append(name)
    return tuple(out)


def _structure(q: Question, found: SearchResult, point: Point) -> dict[str, float]:
    """By channel, loss that a flexible function of what the car was doing would take away."""
    evidence, rows = q.train.evidence, _rows(q, point)
    r = remove_frame_wait(evidence, point.vehicle, point.timing, found.noise)
    policy = q.settings.policy.unexplained
    share = explained_shares(group_residuals(evidence, point.vehicle, r, found.noise, policy),
                             q.settings.seed, policy)
    total = _by_channel(q, rows, point.weight * point.noise.loss(point.residual))
    return {c: share.get(c, 0.0) * total[c] for c in total}


def _taken(q: Question, before: Point, after: Point) -> dict[str, float]:
    """By channel, the drop of the loss."""
    return _by_channel(q, _rows(q, after), before.weight * before.noise.loss(before.residual)
                       - after.weight * after.noise.loss(after.residual))


def _by_channel(q: Question, rows: RowLabels, x: FloatArray) -> dict[str, float]:
    out: dict[str, float] = {}
    for column in np.unique(rows.channel):
        name = q.train.evidence.channel(int(column))
        out[name] = out.get(name, 0.0) + float(x[rows.channel == column].sum())
    return out


def _rows(q: Question, point: Point) -> RowLabels:
    return label_point_rows(q.train.evidence, point, q.settings.policy)
