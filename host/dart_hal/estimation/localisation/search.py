"""Where in a map a scan was taken, when nothing is known: every place and every heading.

The end points of every ninth beam are laid on the map from places 10 cm apart under headings 4 deg
apart, all places of a heading at once: a beam's end moves by whole cells of the raster with the
place. The best are refined by the matcher and judged by rays: what a beam should meet first, not
only whether its end is on some wall. Where another place is nearly as good, none is told.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import remainder, tau

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.estimation.localisation.field import REACH, Map
from dart_hal.estimation.localisation.health import FITS, Agreement, agreement
from dart_hal.estimation.localisation.matcher import C, match

EVERY, HEADINGS, PLACE = 9, 90, 0.10
"""Beams of the coarse score; of a turn; m between places."""
BEST = 25
"""Coarse places that are refined."""
CLEAR = 0.08
"""m: a car is not in a wall, and its axle not nearer to one."""
MARGIN = 0.06
"""By which worth must exceed that of the best other place."""
APART, TURNED = 0.3, 0.25
"""m and rad beyond which a place is another one."""
Worth = NDArray[np.float32]
LOOSE = np.diag(1.0 / np.array((0.3, 0.3, 0.2, 0.008))**2)
"""What is known when the refinement begins, and that distances are right to 0.8 %."""


@dataclass(frozen=True, slots=True)
class Found:
    """pose (4,): x, y [m], yaw [rad], scale; agreement of it; other: worth of the best other
    place."""

    pose: FloatArray
    agreement: Agreement
    other: float

    @property
    def sure(self) -> bool:
        """Whether no other place is nearly as good."""
        return self.agreement.worth > self.other + MARGIN

    @property
    def fits(self) -> bool:
        """Whether this may be the room of the map."""
        return self.agreement.proof() >= FITS

    @property
    def known(self) -> bool:
        """Whether it is: in another room of the same outline boxes stand elsewhere."""
        return self.fits and self.agreement.familiar


def search(chart: Map, points: FloatArray, rays: FloatArray, origin: FloatArray) -> Found:
    """The best place for a scan; points, rays (n, 2) [m] as ``match`` takes them, origin (n, 2)
    [m]: of each beam in the same axes."""
    judged: list[tuple[Agreement, FloatArray]] = []
    for start in _coarse(chart, points[::EVERY]):
        pose = match(chart, points, rays, start, LOOSE).pose
        if all(_another(pose, known) for _, known in judged):
            judged.append((agreement(chart, pose, points, rays, origin), pose))
    judged.sort(key=lambda one: -one[0].worth)
    others = [agreed.worth for agreed, _ in judged[1:]]
    return Found(judged[0][1], judged[0][0], max(others, default=-1.0))


def _another(a: FloatArray, b: FloatArray) -> bool:
    turn = abs(remainder(a[2] - b[2], tau))
    return bool(np.hypot(*(a[:2] - b[:2])) > APART or turn > TURNED)


def _coarse(chart: Map, points: FloatArray) -> list[FloatArray]:
    """The best coarse poses (4,), the best first, no two of them the same place."""
    sheets, apart, free = _sheets(chart)
    rows, columns = free.shape
    scores = np.zeros((HEADINGS, rows, columns), dtype=np.float32)
    for k, score in enumerate(scores):
        c, s = np.cos(tau * k / HEADINGS), np.sin(tau * k / HEADINGS)
        turned = points @ np.array(((c, s), (-s, c)))
        _add(score, sheets, np.round(turned / chart.cell).astype(int), apart)
    scores *= free
    poses: list[FloatArray] = []
    for at in np.argsort(scores, axis=None)[:-40 * BEST:-1]:
        k, j, i = np.unravel_index(at, scores.shape)
        step = apart * chart.cell
        pose = np.array((chart.origin[0] + i * step, chart.origin[1] + j * step,
                         tau * k / HEADINGS, 0.0))
        if all(_another(pose, known) for known in poses):
            poses.append(pose)
            if len(poses) == BEST:
                break
    return poses


def _add(score: Worth, sheets: Worth, offset: IntArray, apart: int) -> None:
    """Add what each beam's end (n, 2), in cells from the place, is worth."""
    rows, columns = score.shape
    whole, part = np.divmod(offset, apart)
    for (i, j), (a, b) in zip(whole.tolist(), part.tolist(), strict=True):
        left, right = max(-i, 0), min(columns, columns - i)
        low, high = max(-j, 0), min(rows, rows - j)
        if left < right and low < high:
            score[low:high, left:right] += sheets[b, a, low + j:high + j, left + i:right + i]


@lru_cache(maxsize=4)
def _sheets(chart: Map) -> tuple[Worth, int, Worth]:
    """What an end is worth at each node, as sheets [row part, column part] of every ``apart``-th
    node, so that all places of the grid read one of them; where a car may be."""
    apart = max(round(PLACE / chart.cell), 1)
    rows, columns = (-(-n // apart) for n in chart.distance.shape)
    d = np.pad(chart.distance, ((0, rows * apart - chart.distance.shape[0]),
                                (0, columns * apart - chart.distance.shape[1])),
               constant_values=REACH)
    worth = (1.0 / (1.0 + (d / (2.0 * C))**2)).astype(np.float32)
    sheets = worth.reshape(rows, apart, columns, apart).transpose(1, 3, 0, 2).copy()
    free = (d[::apart, ::apart] > CLEAR).astype(np.float32)
    return sheets, apart, free
