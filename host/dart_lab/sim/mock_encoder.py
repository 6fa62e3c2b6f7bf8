"""Edges of one ring at exact times, counted as the firmware counts them."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from random import Random

EDGE_HISTORY = 64
MAX_INTERVAL_CK = 0xFFFF


class MockEncoder:
    """One ring under one sensor; phase in main-gear revolutions, unwrapped.

    Edge times are computed from the phase at the last change of rate, not from small increments,
    so they are independent of the lengths of the runs.
    """

    def __init__(self, marks: Sequence[float]) -> None:
        self.marks = list(marks)
        self._mark_due = self._noise_due = float("inf")
        self._noise = 0.0
        self._random = Random(0)
        self.clear()
        self._t0 = 0.0
        self._phase0 = 0.0
        self._rate = 0.0
        self._next = 0
        self._find_next_mark()

    def clear(self) -> None:
        """Reset the counters, as a boot does; the gear keeps its phase."""
        self.count = self.rejected = 0
        self.last_ck = self.interval_ck = 0
        self.recent: deque[tuple[int, int, int]] = deque(maxlen=EDGE_HISTORY)

    def set_marks(self, marks: Sequence[float], t: float) -> None:
        self.marks = list(marks)
        self.set_rate(self._rate, t)

    def set_rate(self, rev_per_s: float, t: float) -> None:
        """Set the rate of the gear from t on; the phase is continuous."""
        self._phase0 += self._rate * (t - self._t0)
        self._t0 = t
        self._rate = rev_per_s
        self._find_next_mark()

    @property
    def due(self) -> float:
        """Return the time of the next edge [s]."""
        return min(self._mark_due, self._noise_due)

    def set_noise(self, rate: float, t: float) -> None:
        """Add random edges, ``rate`` per second on average, from t on."""
        self._noise = rate
        self._noise_due = t
        self._next_noise()

    def _next_noise(self) -> None:
        self._noise_due = (self._noise_due + self._random.expovariate(self._noise)
                           if self._noise else float("inf"))

    def run(self, until: float, ticks: Callable[[float], int], edge_min_ck: int) -> None:
        """Count all edges up to ``until``; ``ticks`` stamps a time."""
        while self.due <= until:
            self._edge(ticks(self.due), edge_min_ck)
            if self._noise_due < self._mark_due:
                self._next_noise()
            else:
                self._next += 1 if self._rate > 0 else -1
                self._mark_due = self._time_of(self._next)

    def _edge(self, ck: int, edge_min_ck: int) -> None:
        # As in the firmware: an edge too close to the last one is rejected.
        gap = (ck - self.last_ck) & 0xFFFFFFFF
        if self.count and gap < edge_min_ck:
            self.rejected += 1
            return
        self.interval_ck = min(gap, MAX_INTERVAL_CK) if self.count else 0
        self.count += 1
        self.last_ck = ck
        self.recent.append((self.count, ck, self.interval_ck))

    def _find_next_mark(self) -> None:
        """Find the next mark in the direction of motion, and its time."""
        if self._rate == 0.0 or not self.marks:
            self._mark_due = float("inf")
            return
        # Marks have unwrapped indices: turn times their number, plus the index in the turn.
        turn, within = divmod(self._phase0, 1.0)
        k = bisect_right(self.marks, within)
        if self._rate < 0.0 and k and self.marks[k - 1] == within:
            # The gear is exactly at a mark, which it has passed already.
            k -= 1
        self._next = int(turn) * len(self.marks) + (k if self._rate > 0 else k - 1)
        self._mark_due = self._time_of(self._next)

    def _time_of(self, index: int) -> float:
        turn, k = divmod(index, len(self.marks))
        return self._t0 + (turn + self.marks[k] - self._phase0) / self._rate
