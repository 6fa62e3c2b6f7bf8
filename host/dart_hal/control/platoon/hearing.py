"""What a predecessor told last: in order, of now, and possible; what is not is counted."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import inf, isfinite

# s that a told acceleration counts, six messages of 20 Hz: at 50 % loss one gap of 64 is longer;
# and that a speed does, as poses of the fleet.
FRESH = 0.3
LOST = 0.5
# s that two clocks may differ.
EARLY = 0.05
# s; told each 0.05 s, a time is computed anew with each look, by clocks that are still learnt.
SAME = 0.002
# m/s, m/s2; the limit of the feed-forward deals with what no car does. No speed is believed.
FASTEST = 100.0
HARDEST = 1e6


@dataclass(frozen=True, slots=True)
class Told:
    """speed [m/s] and acceleration [m/s2] at t [s] of the hearer's clock."""

    t: float
    speed: float
    acceleration: float


class Hearing:
    """``counts``: messages by what they were: TAKEN; AGAIN; OVERTAKEN by a newer one; OLD; EARLY,
    from later than now; IMPOSSIBLE."""

    def __init__(self) -> None:
        self.newest: Told | None = None
        self._judged_last = -inf
        self.counts: Counter[str] = Counter()

    def take(self, told: Told, now: float) -> bool:
        """Whether a message counts, at ``now`` [s]."""
        again = abs(told.t - self._judged_last) < SAME
        name = "AGAIN" if again else self._judged(told, now)
        self._judged_last = told.t
        self.counts[name] += 1
        if name == "TAKEN":
            self.newest = told
        return name == "TAKEN"

    def age(self, now: float) -> float:
        """s of what counts; inf: nothing ever did."""
        return inf if self.newest is None else max(now - self.newest.t, 0.0)

    def _judged(self, told: Told, now: float) -> str:
        if not (all(map(isfinite, (told.t, told.speed, told.acceleration)))
                and abs(told.speed) <= FASTEST and abs(told.acceleration) <= HARDEST):
            return "IMPOSSIBLE"
        if told.t > now + EARLY:
            return "EARLY"
        if now - told.t > LOST:
            return "OLD"
        if self.newest is not None and told.t < self.newest.t + SAME:
            return "OVERTAKEN"
        return "TAKEN"
