"""How the loop runs: periods, losses, ages."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

KEPT = 1000
"""Loop periods that are judged: 10 s at 100 Hz."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Loop periods p50, p99, max [s]; frames lost and damaged on the line, States
    skipped by a slow loop; age of the last frame [s]; pulses written per frame."""

    p50: float
    p99: float
    max: float
    lost: int
    damaged: int
    skipped: int
    link_age: float


class LoopTimer:
    """Collects the times at which the user's loop asked for a State."""

    def __init__(self) -> None:
        self._periods: deque[float] = deque(maxlen=KEPT)
        self._last: float | None = None
        self.skipped = 0

    def tick(self, now: float, skipped: int) -> None:
        if self._last is not None:
            self._periods.append(now - self._last)
        self._last = now
        self.skipped += skipped

    def quantiles(self) -> tuple[float, float, float]:
        """p50, p99, max [s]; NaN before two States."""
        ordered = sorted(self._periods)
        if not ordered:
            return float("nan"), float("nan"), float("nan")
        last = len(ordered) - 1
        return ordered[last // 2], ordered[int(last * 0.99)], ordered[last]
