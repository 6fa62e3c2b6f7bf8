"""How the loop runs: periods, losses, ages."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from dart_hal.actuation.limits import LONGEST_VALIDITY
from dart_hal.errors import UsageError
from dart_hal.types import SAMPLE

SLOWEST = round(LONGEST_VALIDITY / SAMPLE / 2)
"""Frames from one State of a loop to its next, 25: a command that may hold for 0.5 s outlives
one round of the loop that comes too late."""
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


def check_every(every: int) -> None:
    """Refuse a loop that no command would outlive. Raises UsageError."""
    if isinstance(every, bool) or not isinstance(every, int) or not 1 <= every <= SLOWEST:
        raise UsageError(f"states(every={every!r}) is no part of the stream", found=repr(every),
                         expected=f"1 to {SLOWEST}: a command holds for at most "
                         f"{LONGEST_VALIDITY} s, and must outlive a late round",
                         remedy="states(every=10) for 10 Hz")


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
