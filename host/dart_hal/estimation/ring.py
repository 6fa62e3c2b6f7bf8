"""Positions of the edges of an encoder ring: table, learning, alignment.

Interval i lies between edge i and edge i + 1. A table holds N fractions, the
interval divided by the mean, sum N. The Nano counts from an arbitrary edge
after every start, so the shift between count and table must be found first.
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
# Frames before a shift is accepted: the score is then a mean over more than two dozen different
# intervals, and 3 % of unevenness is clear against 0.05 % of stamp noise.
MIN_ALIGN_FRAMES = 40
# Frames after which the best shift is accepted, or half of the score is discarded.
MAX_ALIGN_FRAMES = 400


class Ring:
    """Maps an edge index to metres of travel; evenly spaced unless a table is given."""

    def __init__(self, metres_per_edge: float, edges_per_rev: int,
                 fractions: Sequence[float] | None = None) -> None:
        if fractions is not None and len(fractions) != edges_per_rev:
            raise ValueError(f"ring table of {len(fractions)} for {edges_per_rev} edges")
        self.n = edges_per_rev
        self.metres = metres_per_edge
        self.turn = metres_per_edge * edges_per_rev
        scale = self.turn / sum(fractions) if fractions is not None else metres_per_edge
        self.gaps = tuple(f * scale for f in fractions or (1.0,) * edges_per_rev)
        self._positions = (0.0, *accumulate(self.gaps))

    def position(self, edge: int) -> float:
        """Return the travel [m] from edge 0 to ``edge``; any integer."""
        turns, rest = divmod(edge, self.n)
        return turns * self.turn + self._positions[rest]

    def gap(self, interval: int) -> float:
        """Return the length [m] of the interval between edge ``interval`` and the next."""
        return self.gaps[interval % self.n]

    def edge_at(self, travel: float) -> int:
        """Return the index of the last edge at or before ``travel`` [m]."""
        turns, rest = divmod(travel, self.turn)
        return int(turns) * self.n + bisect_right(self._positions, rest) - 1


class Aligner:
    """Finds the shift between the count since boot and the table.

    Each frame compares the newest single interval with the mean speed over the
    newest edges; only with the right shift do they agree.
    """

    def __init__(self, ring: Ring) -> None:
        self._ring = ring
        self._scores = [0.0] * ring.n
        self._frames = 0
        self._recent: deque[tuple[int, float]] = deque()

    def clear(self) -> None:
        """Drop the collected edges: no pair may span a standstill or a reversal."""
        self._recent.clear()

    def offer(self, edge: int, t: float, interval: int, seconds: float) -> int | None:
        """Add the newest edge, its time and the interval that it ended; return the shift or None.

        The mean speed is taken over at least a frame and at most one revolution. A complete
        revolution gives the exact mean speed for any shift.
        """
        ring = self._ring
        recent = self._recent
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
        return self._decide() if self._frames >= MIN_ALIGN_FRAMES else None

    def _decide(self) -> int | None:
        """Return the best shift if it is clearly better than the others, else None."""
        order = sorted(self._scores)
        best = order[0]
        median = order[len(order) // 2]
        clear = best < 0.25 * median
        alone = best < 0.5 * order[1]
        if clear and (alone or self._frames >= MAX_ALIGN_FRAMES):
            return self._scores.index(best)
        if self._frames >= MAX_ALIGN_FRAMES:
            self._scores = [0.5 * s for s in self._scores]
            self._frames = MAX_ALIGN_FRAMES // 2
        return None


@dataclass(frozen=True, slots=True)
class LearntRing:
    """Result of learning.

    fractions (n,), sum n; std (n,): their standard errors; revolutions: number of complete ones;
    residual: rms, relative; interval: rms of the mean interval [ck].
    """

    fractions: FloatArray
    std: FloatArray
    revolutions: float
    residual: float
    interval: float


class RingLearner:
    """Collects EDGES frames at nearly constant speed and learns the table."""

    def __init__(self) -> None:
        self._runs: list[tuple[int, list[float]]] = []

    def add(self, first_count: int, intervals: Iterable[int]) -> None:
        """Add one EDGES frame: ``first_count`` ends the first interval; intervals in ck.

        Consecutive frames are joined. A saturated interval ends a run.
        """
        start = first_count - 1
        run: list[float] = []
        for k, ck in enumerate(intervals):
            if ck == SATURATED_CK or ck == 0:
                self._append_run(start, run)
                start = first_count + k
                run = []
            else:
                run.append(float(ck))
        self._append_run(start, run)

    def _append_run(self, start: int, run: list[float]) -> None:
        """Append intervals to the last run if they continue it, else start a new run."""
        if not run:
            return
        if self._runs and self._runs[-1][0] + len(self._runs[-1][1]) == start:
            self._runs[-1][1].extend(run)
        else:
            self._runs.append((start, run))

    @property
    def intervals(self) -> int:
        """Return the number of collected intervals."""
        return sum(len(run) for _, run in self._runs)

    def learn(self, edges_per_rev: int) -> LearntRing:
        """Compute the table for a ring with ``edges_per_rev`` edges.

        1. Divide each interval by the mean of the revolution centred on it.
        2. Average over the revolutions, for each interval of the ring.
        3. Correct each value for the acceleration: the centre of the revolution is not exactly the
           centre of the interval. Average again.

        Raises ValueError below two revolutions.
        """
        parts = [normalise_intervals(np.array(run), start, edges_per_rev)
                 for start, run in self._runs]
        parts = [p for p in parts if p[0].size]
        if not parts:
            raise ValueError(f"{self.intervals} joined intervals are too few for "
                             f"{edges_per_rev} edges")
        index, value, around = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        gains = np.concatenate([np.gradient(p[2]) for p in parts]) / around
        counts = np.bincount(index, minlength=edges_per_rev)
        if counts.min() < 1 or value.size < edges_per_rev:
            raise ValueError(
                f"{self.intervals} joined intervals are too few for {edges_per_rev} edges")
        mean = np.bincount(index, value, edges_per_rev) / counts
        value = value * (1.0 + gains * centre_offsets(mean)[index])
        mean = np.bincount(index, value, edges_per_rev) / counts
        fractions = mean * (edges_per_rev / mean.sum())
        residual = value - mean[index]
        spread = np.sqrt(np.bincount(index, residual**2, edges_per_rev)
                         / np.maximum(counts - 1, 1))
        return LearntRing(fractions, spread / np.sqrt(counts), value.size / edges_per_rev,
                          float(np.sqrt(np.mean(residual**2))),
                          float(np.sqrt(np.mean(around**2))))

    def period(self, candidates: Iterable[int]) -> int:
        """Return the number of edges per revolution that repeats best (a missing tooth lowers it).

        The smallest candidate whose residual is within 20 % of the best one,
        so that a multiple does not win by its additional parameters.
        """
        residual = {n: self.learn(n).residual for n in candidates}
        limit = 1.2 * min(residual.values()) + 1e-12
        return min(n for n, r in residual.items() if r <= limit)


def normalise_intervals(run: FloatArray, start: int, n: int
                        ) -> tuple[np.ndarray, FloatArray, FloatArray]:
    """Divide each interval of a run by the mean of the revolution centred on it.

    The centred mean of n + 1 (half weights at its ends) is symmetric: a steady
    acceleration cancels. Returns index on the ring, ratio and mean, each (k,).
    """
    if run.size < n + 2:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    weights = _revolution_weights(n)
    half = n // 2
    mean = np.convolve(run, weights / n, "valid")
    inner = run[half:half + mean.size]
    index = (start + half + np.arange(mean.size)) % n
    return index, inner / mean, mean


def centre_offsets(fractions: FloatArray) -> FloatArray:
    """Distance (n,) from the centre of an interval to the centre of the revolution around it.

    In mean intervals; 0 for an even ring.
    """
    n = len(fractions)
    weights = _revolution_weights(len(fractions))
    turns = np.concatenate([fractions] * 3)
    middle = np.cumsum(turns) - 0.5 * turns
    around = np.convolve(turns * middle, weights, "same") / np.convolve(turns, weights, "same")
    return np.asarray((around - middle)[n:2 * n])


def _revolution_weights(n: int) -> FloatArray:
    """Return the weights of the intervals of a revolution around one of them."""
    weights = np.full(2 * (n // 2) + 1, 1.0)
    if n % 2 == 0:
        weights[[0, -1]] = 0.5
    return weights
