"""One follower of a platoon: from gap, reported speed and own speed to an acceleration.

    CACC   the predecessor's acceleration is fed forward
    ACC    it is not: no report for 0.3 s, or the reports do not match the motion. Without reported
           speeds the lidar supplies the speed, and the car ahead may be at rest at any time
    STOP   no gap is known for 0.5 s: brakes to rest

In every mode the safety filter (``safe``) has the last word. It assumes that the predecessor has
braked fully since its newest report, down to rest, and the gap that remains if it brakes so:
missing messages only make it more careful.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import inf

from dart_hal.control.platoon.detector import AttackDetector
from dart_hal.control.platoon.gains import STABLE, PlatoonGains
from dart_hal.control.platoon.hearing import (
    MAX_ACCELERATION_AGE,
    MAX_SPEED_AGE,
    PredecessorReport,
    ReportFilter,
)
from dart_hal.control.platoon.laws import acc, clip, limit_feed_forward
from dart_hal.control.platoon.safe import PendingCommands, SafetyMargins, safe_acceleration
from dart_hal.core.types import TextEnum

# Longest time without a gap [s], four scans.
MAX_GAP_AGE = 0.5
# Gain of a measured gap, and of its rate in the estimate of the predecessor's speed without
# reports.
GAP_GAIN = 0.5
SPEED_GAIN = 0.15
# Time without a report after which the lidar has estimated that speed [s]: a dozen scans.
MAX_LEARNING_AGE = 1.5
# Gain of the mean difference between measured and predicted gaps, and the mean [m] that proves
# false reports. Noise of 2 cm causes 0.5 cm; a reported speed that is wrong by 0.16 m/s ends at 4
# cm.
DRIFT_GAIN = 0.1
MAX_DRIFT = 0.04


class PlatoonMode(TextEnum):
    """How it follows; LEAD: it is the first car."""

    LEAD = "LEAD"
    CACC = "CACC"
    ACC = "ACC"
    STOP = "STOP"


@dataclass(frozen=True, slots=True)
class Gap:
    """Distance from the predecessor's tail to the own nose at t [s]; error [m]: largest error."""

    t: float
    metres: float
    error: float


class PlatoonFollower:
    """Call ``answer`` each ``dt`` s and feed ``hearing`` with the reports.

    ``mode``; ``why``: reason of a mode other than CACC; ``counts``: calls in each mode by its name,
    and those with an acceleration of the safety filter, RULE.

    gap [m]: estimate for now; ``predecessor_speed`` [m/s]; ``distrusts``: the reports are not used
    any more. rule False, no compensation: as published. trust: gain of a measured gap, 1: it is
    exact.
    """

    def __init__(
        self,
        gains: PlatoonGains = STABLE,
        dt: float = 0.05,
        delay: float = 0.1,
        margins: SafetyMargins | None = None,
        *,
        rule: bool = True,
        compensated: bool = True,
        detects: bool = True,
        trust: float = GAP_GAIN,
    ) -> None:
        self.gains = gains
        self.dt = dt
        self.margins = margins or SafetyMargins()
        self.hearing = ReportFilter()
        self.detector = AttackDetector(dt)
        self.mode = PlatoonMode.STOP
        self.why = "no gap was measured yet"
        self.counts: Counter[str] = Counter()
        self.gap = inf
        self.error = 0.0
        self.predecessor_speed = self._drift = 0.0
        self._gap_deficit = self._speed_deficit = 0.0
        """Largest errors [m], [m/s] by which gap and predecessor speed may be smaller."""
        self.distrusts = False
        self._rule = rule
        self._compensated = compensated
        self._detects = detects
        self._trust = trust
        self._pending = PendingCommands(delay, dt, gains.v_max, self.margins.b_s)
        self._forward = 0.0
        self._speed: float | None = None
        self._gap_t = -inf

    def answer(self, t: float, speed: float, gap: Gap | None = None) -> float:
        """Return the acceleration [m/s2] at t [s] with the own speed [m/s]; gap: None without a new
        one.

        1. Predict gap and predecessor speed, correct them by a new gap.
        2. Check the reports by the detector; select the mode.
        3. Linear law for the state after the pending commands.
        4. Limit by the safety filter, with the worst case of the predecessor, and by the car.
        """
        self._predict_gap(t, speed)
        self._correct_gap(t, speed, gap)
        report, age = self._trusted_report(t)
        if report is not None and age <= MAX_SPEED_AGE and self._detects:
            acceleration = (speed - self._speed) / self.dt if self._speed is not None else 0.0
            self.detector.update(speed, report.speed, acceleration, report.acceleration)
        else:
            self.detector.restart()
        self._speed = speed
        self._select_mode(t, age)
        distance, speed_then = self._pending.predict(speed)
        nominal = (
            self.gains.u_min
            if self.mode is PlatoonMode.STOP
            else self._linear_law(speed, distance, speed_then)
        )
        u = nominal
        if self._rule and self.gap < inf:
            b_p = self.margins.b_p
            min_speed = max(report.speed - b_p * age, 0.0) if report is not None else 0.0
            bound = safe_acceleration(
                self.gap - self._gap_deficit,
                distance,
                speed_then,
                min_speed,
                self.dt,
                self._margins(),
            )
            self.counts["RULE"] += int(bound < nominal)
            u = min(nominal, bound)
        u = clip(self.gains, u)
        self._pending.send(u)
        self.counts[self.mode.value] += 1
        return u

    def _trusted_report(self, t: float) -> tuple[PredecessorReport | None, float]:
        """Return the newest trusted report and its age [s]."""
        return (None, inf) if self.distrusts else (self.hearing.newest, self.hearing.age(t))

    def _predict_gap(self, t: float, speed: float) -> None:
        """Predict the predecessor's speed by its report, and the gap by both speeds over the step.

        _gap_deficit and _speed_deficit: by how much both are less if the predecessor has braked
        fully since its report.
        """
        report, age = self._trusted_report(t)
        last_speed = self.predecessor_speed
        last_deficit = self._speed_deficit
        if report is not None and age <= MAX_SPEED_AGE:
            self.predecessor_speed = max(report.speed, 0.0)
        if report is not None and age <= MAX_LEARNING_AGE:
            min_speed = report.speed - self.margins.b_p * age
        else:
            min_speed = self.predecessor_speed - self.margins.b_p * (t - self._gap_t)
        self._speed_deficit = max(self.predecessor_speed - max(min_speed, 0.0), 0.0)
        if self.gap < inf:
            own_speed = speed if self._speed is None else 0.5 * (self._speed + speed)
            self.gap += (0.5 * (last_speed + self.predecessor_speed) - own_speed) * self.dt
            self._gap_deficit += 0.5 * (last_deficit + self._speed_deficit) * self.dt

    def _correct_gap(self, t: float, speed: float, gap: Gap | None) -> None:
        """Correct the predicted gap by a new one; without reports also the speed."""
        if gap is None or gap.t <= self._gap_t:
            return
        new = gap.metres + (self.predecessor_speed - speed) * (t - gap.t)
        if self.gap == inf or t - self._gap_t > MAX_GAP_AGE:
            self.gap = new
            self._gap_deficit = 0.0
        else:
            innovation = new - self.gap
            self.gap += self._trust * innovation
            self._gap_deficit *= 1.0 - self._trust
            self._drift += DRIFT_GAIN * (innovation - self._drift)
            self.distrusts |= self._detects and abs(self._drift) > MAX_DRIFT
            if self._trusted_report(t)[1] > MAX_SPEED_AGE:
                since = max(gap.t - self._gap_t, self.dt)
                self.predecessor_speed = min(
                    max(self.predecessor_speed + SPEED_GAIN * innovation / since, 0.0),
                    self.gains.v_max,
                )
        self._gap_t = gap.t
        self.error = gap.error

    def _select_mode(self, t: float, age: float) -> None:
        """Select mode and reason."""
        if t - self._gap_t > MAX_GAP_AGE:
            self.mode = PlatoonMode.STOP
            self.why = f"no gap is known for {MAX_GAP_AGE:g} s"
        elif self.distrusts:
            self.mode = PlatoonMode.ACC
            self.why = "its position does not match its reported speed"
        elif self.detector.attacked:
            self.mode = PlatoonMode.ACC
            self.why = "it does not drive its reported acceleration"
        elif age > MAX_ACCELERATION_AGE:
            self.mode = PlatoonMode.ACC
            self.why = f"no report for {MAX_ACCELERATION_AGE:g} s"
        else:
            self.mode = PlatoonMode.CACC
            self.why = ""

    def _linear_law(self, speed: float, distance: float, speed_then: float) -> float:
        """Return the linear law plus the feed-forward of the reported acceleration."""
        gains = self.gains
        gap = self.gap
        if self._compensated:
            gap = gap - distance + self.predecessor_speed * self._pending.delay
            speed = speed_then
        reported = self.hearing.newest.acceleration if self.hearing.newest is not None else 0.0
        feed_forward = gains.share * reported if self.mode is PlatoonMode.CACC else 0.0
        self._forward += gains.beta * (feed_forward - self._forward)
        u = acc(gains, gap, speed, self.predecessor_speed)
        if self.mode is PlatoonMode.CACC:
            u += limit_feed_forward(gains, gap, speed, self.predecessor_speed, self._forward)
        return u

    def _margins(self) -> SafetyMargins:
        """Return the margins with the error of the present gap."""
        m = self.margins
        return SafetyMargins(m.b_s, m.b_p, max(self.error, m.e_g), m.e_v, m.m)


# Name of version 0.1.
Follower = PlatoonFollower
