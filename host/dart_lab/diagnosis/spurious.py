"""Find causes of a search that do not reduce the structure of the residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray
from dart_lab.identification.evidence.rows import RowLabels
from dart_lab.identification.objective import Point

from .gates import Candidate, explain_failure
from .question import DiagnosisSetup
from .result import Unexplained
from .search.forward import SearchResult
from .search.selection import label_point_rows
from .unexplained.structure import explained_shares, group_residuals
from .unexplained.waits import remove_frame_wait


def find_spurious(q: DiagnosisSetup, found: SearchResult, structure: Sequence[Unexplained]
                  ) -> tuple[str, ...]:
    """Find spurious causes by the structure of the residuals.

    For each cause, in the channels with structure where it mainly acts:

    1. Fit the other causes without it.
    2. Compare three losses: the structure with the cause, the structure without it, and what the
       cause removes of the whole loss.
    3. The cause is spurious if the remaining structure exceeds both what it removes and most of
       the structure without it. An unknown second cause alone would not make it spurious.

    Differences between recordings are no evidence for a cause that is the same in all.
    """
    if all("recording" in u.along for u in structure):
        return ()
    policy = q.settings.policy.conclusion
    with_cause = _structure_losses(q, found, found.point)
    spurious = []
    names = [n.effect for n in found.accepted]
    for name in names:
        # 1. The fit without this cause.
        others = q.search.fit_subset(found.point, found.noise, [n for n in names if n != name],
                              found.point)
        # 2. What the cause removes, by channel; only channels with structure in which it mainly
        #    acts.
        drops = _loss_drops(q, others, found.point)
        total = sum(max(drop, 0.0) for drop in drops.values())
        channels = [u.channel for u in structure if "recording" not in u.along
                    and drops.get(u.channel, 0.0) > policy.min_channel_share * total]
        # 3. Compare the structure with and without it.
        without_cause = _structure_losses(q, found, others) if channels else {}
        if any(explain_failure("structure", Candidate(
                structure_after=with_cause[c], structure_before=without_cause[c],
                structure_removed=drops[c]), q.settings.policy) for c in channels):
            spurious.append(name)
    return tuple(spurious)


def _structure_losses(q: DiagnosisSetup, found: SearchResult, point: Point) -> dict[str, float]:
    """Return by channel the loss that a flexible function of the driving state would remove."""
    evidence = q.train.evidence
    rows = label_point_rows(evidence, point)
    r = remove_frame_wait(evidence, point.vehicle, point.timing, found.noise)
    policy = q.settings.policy.unexplained
    residuals = group_residuals(evidence, point.vehicle, r, found.noise)
    share = explained_shares(residuals, q.settings.seed, policy)
    total = _sum_by_channel(q, rows, point.weight * point.noise.loss(point.residual))
    return {c: share.get(c, 0.0) * total[c] for c in total}


def _loss_drops(q: DiagnosisSetup, reference: Point, changed: Point) -> dict[str, float]:
    """Return the drop of the loss by channel, from one fit to another."""
    reference_loss = reference.weight * reference.noise.loss(reference.residual)
    changed_loss = changed.weight * changed.noise.loss(changed.residual)
    rows = label_point_rows(q.train.evidence, changed)
    return _sum_by_channel(q, rows, reference_loss - changed_loss)


def _sum_by_channel(q: DiagnosisSetup, rows: RowLabels, x: FloatArray) -> dict[str, float]:
    """Sum values (N,) of the stacked residuals by channel."""
    out: dict[str, float] = {}
    for column in np.unique(rows.channel):
        name = q.train.evidence.channel(int(column))
        out[name] = out.get(name, 0.0) + float(x[rows.channel == column].sum())
    return out
