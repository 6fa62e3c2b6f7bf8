"""One follower of a platoon: gap, told speed and own speed in, acceleration out.

    CACC   the predecessor's acceleration is fed forward
    ACC    it is not: nothing was heard for 0.3 s, or what is told is not what is driven; where even
           the told speed is not, the lidar's has to do, and the car ahead may stand at any time
    STOP   no gap is known for 0.5 s: brakes to rest

In every mode the rule of ``safe`` has the last word. It counts on the newest told speed less what a
full brake takes off it since, down to a predecessor that stands, and on the gap that is left if it
brakes so: silence only makes it careful.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum
from math import inf

from dart_hal.control.platoon.detector import Detector
from dart_hal.control.platoon.gains import STABLE, Gains
from dart_hal.control.platoon.hearing import FRESH, LOST, Hearing, Told
from dart_hal.control.platoon.laws import acc, clipped, limited
from dart_hal.control.platoon.safe import Margins, Underway, safe

# s without a gap, four scans.
BLIND = 0.5
# Of a measured gap, and of what it says of the predecessor's speed while that tells nothing.
TRUST = 0.5
LEARN = 0.15
# s without a message, after which the lidar has learnt that speed: a dozen scans.
LEARNT = 1.5
# Of each new gap in the mean by which gaps come otherwise than the told speed leads; and m of it
# that are a lie. Noise of 2 cm leaves 0.5 cm of mean; a speed told 0.16 m/s wrong ends at 4 cm.
DRIFT = 0.1
BEYOND = 0.04


class Mode(str, Enum):
    """How it follows; LEAD: it is the first."""

    LEAD = "LEAD"
    CACC = "CACC"
    ACC = "ACC"
    STOP = "STOP"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class Gap:
    """metres [m] from the predecessor's tail to the own nose at t [s]; error [m]: at most."""

    t: float
    metres: float
    error: float


class Follower:
    """``answer`` each ``dt`` s, with ``hearing`` fed as messages come. ``mode`` and, where it is
    not CACC, ``why``; ``counts``: answers in each mode by its name, and those that the RULE made.

    gap [m]: as it is thought to be now, ``ahead`` [m/s]: the predecessor's speed; doubted: what it
    tells of it is not believed, for good. rule False, no
    compensation: as published. trust: of one measured gap, 1: it is exact.
    """

    def __init__(self, gains: Gains = STABLE, dt: float = 0.05, delay: float = 0.1,
                 margins: Margins | None = None, *, rule: bool = True, compensated: bool = True,
                 detects: bool = True, trust: float = TRUST) -> None:
        self.gains = gains
        self.dt = dt
        self.margins = margins or Margins()
        self.hearing = Hearing()
        self.detector = Detector(dt)
        self.mode = Mode.STOP
        self.why = "nothing was seen yet"
        self.counts: Counter[str] = Counter()
        self.gap = inf
        self.error = 0.0
        self.ahead = self._drift = 0.0
        self._short = self._slower = 0.0
        """m, m/s by which the gap and the predecessor's speed may be less than they are thought."""
        self.doubted = False
        self._rule = rule
        self._compensated = compensated
        self._detects = detects
        self._trust = trust
        self._underway = Underway(delay, dt, gains.v_max, self.margins.b_s)
        self._forward = 0.0
        self._speed: float | None = None
        self._seen = -inf

    def answer(self, t: float, speed: float, gap: Gap | None = None) -> float:
        """Acceleration [m/s2] to ask for at t [s] with the own speed [m/s]; gap: None without a
        new one."""
        self._go_on(t, speed)
        self._see(t, speed, gap)
        told, age = self._told(t)
        if told is not None and age <= LOST and self._detects:
            driven = (speed - self._speed) / self.dt if self._speed is not None else 0.0
            self.detector.look(speed, told.speed, driven, told.acceleration)
        else:
            self.detector.forget()
        self._speed = speed
        self._judge(t, age)
        way, then = self._underway.through(speed)
        wanted = self.gains.u_min if self.mode is Mode.STOP else self._wanted(speed, way, then)
        u = wanted
        if self._rule and self.gap < inf:
            b_p = self.margins.b_p
            least = max(told.speed - b_p * age, 0.0) if told is not None else 0.0
            bound = safe(self.gap - self._short, way, then, least, self.dt, self._margins())
            self.counts["RULE"] += int(bound < wanted)
            u = min(wanted, bound)
        u = clipped(self.gains, u)
        self._underway.send(u)
        self.counts[self.mode.value] += 1
        return u

    def _told(self, t: float) -> tuple[Told | None, float]:
        """What counts of what was told, and its age [s]."""
        return (None, inf) if self.doubted else (self.hearing.newest, self.hearing.age(t))

    def _go_on(self, t: float, speed: float) -> None:
        """The predecessor's speed, as long as it tells it; the gap, by both speeds over the step,
        and by how much it is less where the predecessor has braked fully since it told."""
        told, age = self._told(t)
        before = self.ahead
        slower = self._slower
        if told is not None and age <= LOST:
            self.ahead = max(told.speed, 0.0)
        if told is not None and age <= LEARNT:
            least = told.speed - self.margins.b_p * age
        else:
            least = self.ahead - self.margins.b_p * (t - self._seen)
        self._slower = max(self.ahead - max(least, 0.0), 0.0)
        if self.gap < inf:
            own = speed if self._speed is None else 0.5 * (self._speed + speed)
            self.gap += (0.5 * (before + self.ahead) - own) * self.dt
            self._short += 0.5 * (slower + self._slower) * self.dt

    def _see(self, t: float, speed: float, gap: Gap | None) -> None:
        """The gap of now: what is known goes on, what is new corrects it."""
        if gap is None or gap.t <= self._seen:
            return
        new = gap.metres + (self.ahead - speed) * (t - gap.t)
        if self.gap == inf or t - self._seen > BLIND:
            self.gap = new
            self._short = 0.0
        else:
            off = new - self.gap
            self.gap += self._trust * off
            self._short *= 1.0 - self._trust
            self._drift += DRIFT * (off - self._drift)
            self.doubted |= self._detects and abs(self._drift) > BEYOND
            if self._told(t)[1] > LOST:
                since = max(gap.t - self._seen, self.dt)
                self.ahead = min(max(self.ahead + LEARN * off / since, 0.0), self.gains.v_max)
        self._seen = gap.t
        self.error = gap.error

    def _judge(self, t: float, age: float) -> None:
        if t - self._seen > BLIND:
            self.mode = Mode.STOP
            self.why = f"no gap is known for {BLIND:g} s"
        elif self.doubted:
            self.mode = Mode.ACC
            self.why = "it is not where its speed leads"
        elif self.detector.attacked:
            self.mode = Mode.ACC
            self.why = "it does not drive what it tells"
        elif age > FRESH:
            self.mode = Mode.ACC
            self.why = f"nothing was heard for {FRESH:g} s"
        else:
            self.mode = Mode.CACC
            self.why = ""

    def _wanted(self, speed: float, way: float, then: float) -> float:
        """By the linear law, and what is fed forward of the predecessor's acceleration."""
        gains = self.gains
        gap = self.gap
        if self._compensated:
            gap = gap - way + self.ahead * self._underway.delay
            speed = then
        told = self.hearing.newest.acceleration if self.hearing.newest is not None else 0.0
        share = gains.share * told if self.mode is Mode.CACC else 0.0
        self._forward += gains.beta * (share - self._forward)
        u = acc(gains, gap, speed, self.ahead)
        if self.mode is Mode.CACC:
            u += limited(gains, gap, speed, self.ahead, self._forward)
        return u

    def _margins(self) -> Margins:
        m = self.margins
        return Margins(m.b_s, m.b_p, max(self.error, m.e_g), m.e_v, m.m)
