"""Do recordings belong into one map? Days and folders, and how their maps differ.

Trim, linkage and floor change between days; a fit over all of them is a mean
that no car ever had, and its residual does not show which part disagrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date
from itertools import combinations

import numpy as np

from dart_hal.calibration.sessions import day_of, session_of
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording

MAX_DAYS = 3
MAX_DIFFERENCE = 1.0  # deg rms; more is seen on the floor as another radius
BIN = 0.1  # of command: what counts as the same command
MIN_IN_BIN = 20  # samples, 2 s
MIN_BINS = 2


@dataclass(slots=True)
class Group:
    """Recordings of one day and folder: commands (n,) and residuals (n,) rad of its samples."""

    label: str
    day: date | None
    command: list[FloatArray] = field(default_factory=list)
    residual: list[FloatArray] = field(default_factory=list)

    def means(self) -> dict[int, tuple[float, int]]:
        """(mean residual [deg], samples) by bin of command."""
        command, residual = np.concatenate(self.command), np.concatenate(self.residual)
        key = np.round(command / BIN).astype(int)
        return {int(k): (float(np.degrees(residual[key == k].mean())), int((key == k).sum()))
                for k in np.unique(key) if (key == k).sum() >= MIN_IN_BIN}


def groups_of(parts: Sequence[tuple[Recording, FloatArray, FloatArray]]) -> list[Group]:
    """Groups of (recording, command (n,), residual (n,) rad), oldest first, undated last."""
    found: dict[str, Group] = {}
    for recording, command, residual in parts:
        label = session_of(recording)
        group = found.setdefault(label, Group(label, day_of(recording)))
        group.command.append(command)
        group.residual.append(residual)
    return sorted(found.values(), key=lambda g: (g.day or date.max, g.label))


def cautions(groups: Sequence[Group]) -> list[str]:
    """What speaks against one map for all groups; empty when nothing does."""
    said = []
    days = [g.day for g in groups if g.day is not None]
    if days and (max(days) - min(days)).days > MAX_DAYS:
        said.append(f"caution: one map out of {(max(days) - min(days)).days} days, between which "
                    "trim, tyres and floor may have changed: "
                    + ", ".join(g.label for g in groups))
    found = sorted(((*difference(a, b), a.label, b.label) for a, b in combinations(groups, 2)),
                   reverse=True)
    large = [pair for pair in found if pair[0] > MAX_DIFFERENCE]
    if large:
        rms, mean, first, second = large[0]
        more = f"; so do {len(large) - 1} other pair(s) of groups" if len(large) > 1 else ""
        said.append(f"caution: at the same commands {second} lies {rms:.1f} deg rms "
                    f"({mean:+.1f} in the mean) from {first}: another trim, floor, speed or side "
                    f"of approach; fit them apart{more}")
    return said


def difference(first: Group, second: Group) -> tuple[float, float]:
    """(rms, mean) [deg] of second minus first over the commands that both hold; else zeros."""
    a, b = first.means(), second.means()
    shared = sorted(a.keys() & b.keys())
    if len(shared) < MIN_BINS:
        return 0.0, 0.0
    step = np.array([b[k][0] - a[k][0] for k in shared])
    weight = np.array([min(a[k][1], b[k][1]) for k in shared], dtype=np.float64)
    weight /= weight.sum()
    return float(np.sqrt(weight @ step**2)), float(weight @ step)
