"""Where the edges of an encoder ring sit: table, learning, alignment.

Interval i lies between edge i and edge i + 1. A table holds N fractions, the
interval divided by the mean, sum N. The Nano counts from an arbitrary tooth
after every start, so a table fits only after its shift has been found.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from dart_hal.core.types import FloatArray

SATURATED_CK = 65535
ALIGN_MIN = 40
"""Frames before a shift is believed: the score is a mean over two dozen or
more different intervals, 3 % unevenness stands out of 0.05 % stamp noise."""
ALIGN_MAX = 400


class Ring:
    """Metres along the travel for an edge index; even unless a table is given."""

    def __init__(self, metres_per_edge: float, edges_per_rev: int,
                 fractions: Sequence[float] | None = None) -> None:
        if fractions is not None and len(fractions) != edges_per_rev:
            raise ValueError(f"ring table of {len(fractions)} for {edges_per_rev} edges")
        self.n = edges_per_rev
        self.metres = metres_per_edge
        self.turn = metres_per_edge * edges_per_rev
        scale = self.turn / sum(fractions) if fractions is not None else metres_per_edge
        self.gaps = tuple(f * scale for f in fractions or (1.0,) * edges_per_rev)
        self._at = (0.0, *accumulate(self.gaps))

    def position(self, edge: int) -> float:
        """Travel [m] from edge 0 to ``edge``; any integer."""
        turns, rest = divmod(edge, self.n)
        return turns * self.turn + self._at[rest]

    def gap(self, interval: int) -> float:
        """Length [m] of the interval between edge ``interval`` and the next."""
        return self.gaps[interval % self.n]

    def edge_at(self, travel: float) -> int:
        """Index of the last edge at or before ``travel`` [m]."""
        turns, rest = divmod(travel, self.turn)
        return int(turns) * self.n + bisect_right(self._at, rest) - 1


class Aligner:
    """Finds the shift between the count since boot and the table.

    Each frame offers one single interval (the last) beside the mean speed over
    the newest edges; the right shift makes them agree.
    """

    def __init__(self, ring: Ring) -> None:
        self._ring = ring
        self._scores = [0.0] * ring.n
        self._frames = 0
        self._recent: deque[tuple[int, float]] = deque()

    def clear(self) -> None:
        """The wheel stood or turned round: no pair may span it."""
        self._recent.clear()

    def offer(self, edge: int, t: float, interval: int, seconds: float) -> int | None:
        """Newest edge and its time, the interval that it ended; shift or None.

        The mean speed is taken over up to a revolution (a whole one is exact
        whatever the shift), at least over a frame.
        """
        ring, recent = self._ring, self._recent
        recent.append((edge, t))
        while len(recent) > 2 and abs(edge - recent[0][0]) > ring.n:
            recent.popleft()
        first, t_first = recent[0]
        if abs(edge - first) < 2:
            return None
        scale = (t - t_first) / seconds
        for shift in range(ring.n):
            travel = abs(ring.position(edge + shift) - ring.position(first + shift))
            error = ring.gap(interval + shift) / travel * scale - 1.0
            self._scores[shift] += error * error
        self._frames += 1
        return self._decide() if self._frames >= ALIGN_MIN else None

    def _decide(self) -> int | None:
        order = sorted(self._scores)
        best, median = order[0], order[len(order) // 2]
        clear = best < 0.25 * median
        alone = best < 0.5 * order[1]
        if clear and (alone or self._frames >= ALIGN_MAX):
            return self._scores.index(best)
        if self._frames >= ALIGN_MAX:
            self._scores = [0.5 * s for s in self._scores]
            self._frames = ALIGN_MAX // 2
        return None


@dataclass(frozen=True, slots=True)
class LearntRing:
    """Result of learning: fractions shape (n,), sum n; their standard errors;
    full revolutions seen; rms of the relative residual; rms of the mean interval [ck]."""

    fractions: FloatArray
    std: FloatArray
    revolutions: float
    residual: float
    interval: float


class RingLearner:
    """Collects EDGES frames of a near-constant speed and learns the table."""

    def __init__(self) -> None:
        self._runs: list[tuple[int, list[float]]] = []

    def add(self, first_count: int, intervals: Iterable[int]) -> None:
        """One EDGES frame: ``first_count`` ends the first interval; intervals in ck.

        Frames that continue each other are joined. A saturated interval ends a run.
        """
        start = first_count - 1
        run: list[float] = []
        for k, ck in enumerate(intervals):
            if ck == SATURATED_CK or ck == 0:
                self._keep(start, run)
                start, run = first_count + k, []
            else:
                run.append(float(ck))
        self._keep(start, run)

    def _keep(self, start: int, run: list[float]) -> None:
        if not run:
            return
        if self._runs and self._runs[-1][0] + len(self._runs[-1][1]) == start:
            self._runs[-1][1].extend(run)
        else:
            self._runs.append((start, run))

    @property
    def intervals(self) -> int:
        """Intervals collected so far."""
        return sum(len(run) for _, run in self._runs)

    def learn(self, edges_per_rev: int) -> LearntRing:
        """Table for a ring of that many edges.

        Divides each interval by the mean of the revolution around it, then
        averages over revolutions; once more with what an acceleration does where
        the two have not the same middle. Raises ValueError below two revolutions.
        """
        parts = [normalised(np.array(run), start, edges_per_rev) for start, run in self._runs]
        parts = [p for p in parts if p[0].size]
        if not parts:
            raise ValueError(f"{self.intervals} joined intervals are too few for "
                             f"{edges_per_rev} edges")
        tooth, value, around = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        gains = np.concatenate([np.gradient(p[2]) for p in parts]) / around
        seen = np.bincount(tooth, minlength=edges_per_rev)
        if seen.min() < 1 or value.size < edges_per_rev:
            raise ValueError(
                f"{self.intervals} joined intervals are too few for {edges_per_rev} edges")
        mean = np.bincount(tooth, value, edges_per_rev) / seen
        value = value * (1.0 + gains * off_centre(mean)[tooth])
        mean = np.bincount(tooth, value, edges_per_rev) / seen
        fractions = mean * (edges_per_rev / mean.sum())
        residual = value - mean[tooth]
        spread = np.sqrt(np.bincount(tooth, residual**2, edges_per_rev)
                         / np.maximum(seen - 1, 1))
        return LearntRing(fractions, spread / np.sqrt(seen), value.size / edges_per_rev,
                          float(np.sqrt(np.mean(residual**2))),
                          float(np.sqrt(np.mean(around**2))))

    def period(self, candidates: Iterable[int]) -> int:
        """Number of edges per revolution that repeats best (a missing mark lowers it).

        The smallest candidate whose residual is within 20 % of the best one,
        so that a multiple does not win by its freedom.
        """
        residual = {n: self.learn(n).residual for n in candidates}
        limit = 1.2 * min(residual.values()) + 1e-12
        return min(n for n, r in residual.items() if r <= limit)


def normalised(run: FloatArray, start: int, n: int) -> tuple[np.ndarray, FloatArray, FloatArray]:
    """Of one run: tooth index; interval / mean of the revolution centred on it; that mean.

    The centred mean of n + 1 (half weights at its ends) is symmetric: a steady
    acceleration cancels.
    """
    if run.size < n + 2:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    weights = _centred(n)
    half = n // 2
    mean = np.convolve(run, weights / n, "valid")
    inner = run[half:half + mean.size]
    teeth = (start + half + np.arange(mean.size)) % n
    return teeth, inner / mean, mean


def off_centre(fractions: FloatArray) -> FloatArray:
    """By how much (n,) the middle of the revolution around an interval lies ahead of its own
    middle, in mean intervals; 0 for an even ring."""
    n, weights = len(fractions), _centred(len(fractions))
    turns = np.concatenate([fractions] * 3)
    middle = np.cumsum(turns) - 0.5 * turns
    around = np.convolve(turns * middle, weights, "same") / np.convolve(turns, weights, "same")
    return np.asarray((around - middle)[n:2 * n])


def _centred(n: int) -> FloatArray:
    """Weights of the intervals of a revolution around one of them."""
    weights = np.full(2 * (n // 2) + 1, 1.0)
    if n % 2 == 0:
        weights[[0, -1]] = 0.5
    return weights
