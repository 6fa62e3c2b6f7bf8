"""Global localisation: the position of a scan in a map, from all places and headings.

1. The end points of every ninth beam are scored from a place every 10 cm under a heading
   every 4 deg. All places of a heading are scored at once: the end of a beam moves by whole
   cells of the raster with the place.
2. The best places are refined by the matcher.
3. Ray casting evaluates them: what a beam meets first, not only whether its end is on some wall.
4. If another place is nearly as good, the result is ambiguous.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import remainder, tau

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.estimation.localisation.field import MAX_FIELD_DISTANCE, Map
from dart_hal.estimation.localisation.health import MIN_PROOF, Agreement, agreement
from dart_hal.estimation.localisation.matcher import C, match

# Every ninth beam is used in the coarse score.
COARSE_STRIDE = 9
# Number of headings of a turn.
HEADINGS = 90
# m between places.
PLACE_SPACING = 0.10
# Coarse places that are refined.
REFINED_PLACES = 25
# m: smallest distance of the axle from a wall.
MIN_CLEARANCE = 0.08
# s: time of a search on one core of the benchmarks' machine, for each place.
PLACE_COST = 9e-6
# Share of that core that repeated searches may take.
MAX_SEARCH_SHARE = 0.2
# Smallest difference of the score to the best other place.
MIN_SCORE_MARGIN = 0.06
# m beyond which a place is another one.
PLACE_DISTANCE = 0.3
# rad, likewise.
PLACE_ANGLE = 0.25
ScoreGrid = NDArray[np.float32]
# Prior information of the refinement; distances are right to 0.8 %.
SEARCH_INFORMATION = np.diag(1.0 / np.array((0.3, 0.3, 0.2, 0.008))**2)


@dataclass(frozen=True, slots=True)
class SearchResult:
    """Result of a search.

    pose (4,): x, y [m], yaw [rad], scale; its agreement; other_score: of the best other place.
    """

    pose: FloatArray
    agreement: Agreement
    other_score: float

    @property
    def is_unique(self) -> bool:
        """Whether no other place is nearly as good."""
        return self.agreement.score > self.other_score + MIN_SCORE_MARGIN

    @property
    def fits(self) -> bool:
        """Whether this may be the room of the map."""
        return self.agreement.proof() >= MIN_PROOF

    @property
    def is_known_room(self) -> bool:
        """Whether this is the room of the map: in another one of the same outline boxes differ."""
        return self.fits and self.agreement.familiar


def search(chart: Map, points: FloatArray, rays: FloatArray, origin: FloatArray) -> SearchResult:
    """Return the best place for a scan.

    points, rays (n, 2) [m]: as ``match`` takes them; origin (n, 2) [m]: of each beam, same axes.
    """
    judged: list[tuple[Agreement, FloatArray]] = []
    for start in _rank_places(chart, points[::COARSE_STRIDE]):
        pose = match(chart, points, rays, start, SEARCH_INFORMATION).pose
        if all(_is_other_place(pose, earlier) for _, earlier in judged):
            judged.append((agreement(chart, pose, points, rays, origin), pose))
    judged.sort(key=lambda candidate: -candidate[0].score)
    others = [agreed.score for agreed, _ in judged[1:]]
    return SearchResult(judged[0][1], judged[0][0], max(others, default=-1.0))


def search_period(chart: Map) -> float:
    """Return the shortest time [s] from one search of a map to the next."""
    return PLACE_COST * _score_sheets(chart)[2].size / MAX_SEARCH_SHARE


def _is_other_place(a: FloatArray, b: FloatArray) -> bool:
    """Whether two poses are different places."""
    turn = abs(remainder(a[2] - b[2], tau))
    return bool(np.hypot(*(a[:2] - b[:2])) > PLACE_DISTANCE or turn > PLACE_ANGLE)


def _rank_places(chart: Map, points: FloatArray) -> list[FloatArray]:
    """Return the best coarse poses (4,), best first, all of them different places."""
    sheets, stride, free = _score_sheets(chart)
    rows, columns = free.shape
    scores = np.zeros((HEADINGS, rows, columns), dtype=np.float32)
    for k, score in enumerate(scores):
        c = np.cos(tau * k / HEADINGS)
        s = np.sin(tau * k / HEADINGS)
        turned = points @ np.array(((c, s), (-s, c)))
        _add_beams(score, sheets, np.round(turned / chart.cell).astype(int), stride)
    scores *= free
    poses: list[FloatArray] = []
    # The best scores, about 40 for each place to be refined, in decreasing order: most are
    # neighbours of a better one and are skipped.
    flat = scores.ravel()
    best = np.argpartition(flat, -min(40 * REFINED_PLACES, flat.size))[-40 * REFINED_PLACES:]
    for index in best[np.argsort(flat[best], kind="stable")[::-1]]:
        k, j, i = np.unravel_index(index, scores.shape)
        step = stride * chart.cell
        pose = np.array((chart.origin[0] + i * step, chart.origin[1] + j * step,
                         tau * k / HEADINGS, 0.0))
        if all(_is_other_place(pose, earlier) for earlier in poses):
            poses.append(pose)
            if len(poses) == REFINED_PLACES:
                break
    return poses


def _add_beams(score: ScoreGrid, sheets: ScoreGrid, offset: IntArray, stride: int) -> None:
    """Add the score of the end of each beam (n, 2), in cells from the place."""
    rows, columns = score.shape
    whole, part = np.divmod(offset, stride)
    for (i, j), (a, b) in zip(whole.tolist(), part.tolist(), strict=True):
        first_column = max(-i, 0)
        last_column = min(columns, columns - i)
        first_row = max(-j, 0)
        last_row = min(rows, rows - j)
        if first_column < last_column and first_row < last_row:
            score[first_row:last_row, first_column:last_column] += sheets[
                b, a, first_row + j:last_row + j, first_column + i:last_column + i]


@lru_cache(maxsize=4)
def _score_sheets(chart: Map) -> tuple[ScoreGrid, int, ScoreGrid]:
    """Score of an end point at each node, and the places where a car may be.

    A place is every ``stride``-th node. An end point that is (i, j) nodes from its place reads, for
    all places, the nodes of one remainder of (j, i) divided by ``stride``. Each such subset of the
    scores is a contiguous array, a sheet: sheets[row remainder, column remainder].
    """
    stride = max(round(PLACE_SPACING / chart.cell), 1)
    rows, columns = (-(-n // stride) for n in chart.distance.shape)
    d = np.pad(chart.distance, ((0, rows * stride - chart.distance.shape[0]),
                                (0, columns * stride - chart.distance.shape[1])),
               constant_values=MAX_FIELD_DISTANCE)
    score = (1.0 / (1.0 + (d / (2.0 * C))**2)).astype(np.float32)
    sheets = score.reshape(rows, stride, columns, stride).transpose(1, 3, 0, 2).copy()
    free = (d[::stride, ::stride] > MIN_CLEARANCE).astype(np.float32)
    return sheets, stride, free
