"""Acceptance of the predecessor's reports: in order, recent and plausible; the others are counted.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import inf, isfinite

# Age up to which a reported acceleration is used [s], six messages at 20 Hz: at 50 % loss one gap
# of 64 is longer; and up to which a speed is used, as poses of the fleet.
MAX_ACCELERATION_AGE = 0.3
MAX_SPEED_AGE = 0.5
# Largest difference of two clocks [s].
MAX_CLOCK_ERROR = 0.05
# Smallest difference between two reports [s]; they are sent every 0.05 s, and a time is converted
# again at each reading, with clock offsets that are still estimated.
MIN_TIME_STEP = 0.002
# Plausible speeds [m/s] and accelerations [m/s2]; the limit of the feed-forward handles
# accelerations that no car has.
MAX_REPORTED_SPEED = 100.0
MAX_REPORTED_ACCELERATION = 1e6


@dataclass(frozen=True, slots=True)
class PredecessorReport:
    """Speed [m/s] and acceleration [m/s2] at t [s] of the receiver's clock."""

    t: float
    speed: float
    acceleration: float


class ReportFilter:
    """``counts``: reports by class: TAKEN; AGAIN: repeated; OVERTAKEN: older than the newest; OLD;
    EARLY: from the future; IMPOSSIBLE.
    """

    def __init__(self) -> None:
        self.newest: PredecessorReport | None = None
        self._last_t = -inf
        self.counts: Counter[str] = Counter()

    def take(self, report: PredecessorReport, now: float) -> bool:
        """Return whether a report is accepted at ``now`` [s]."""
        is_repeated = abs(report.t - self._last_t) < MIN_TIME_STEP
        name = "AGAIN" if is_repeated else self._classify(report, now)
        self._last_t = report.t
        self.counts[name] += 1
        if name == "TAKEN":
            self.newest = report
        return name == "TAKEN"

    def age(self, now: float) -> float:
        """Return the age of the newest accepted report [s]; inf: none yet."""
        return inf if self.newest is None else max(now - self.newest.t, 0.0)

    def _classify(self, report: PredecessorReport, now: float) -> str:
        """Return the class of a report."""
        if not (
            all(map(isfinite, (report.t, report.speed, report.acceleration)))
            and abs(report.speed) <= MAX_REPORTED_SPEED
            and abs(report.acceleration) <= MAX_REPORTED_ACCELERATION
        ):
            return "IMPOSSIBLE"
        if report.t > now + MAX_CLOCK_ERROR:
            return "EARLY"
        if now - report.t > MAX_SPEED_AGE:
            return "OLD"
        if self.newest is not None and report.t < self.newest.t + MIN_TIME_STEP:
            return "OVERTAKEN"
        return "TAKEN"
