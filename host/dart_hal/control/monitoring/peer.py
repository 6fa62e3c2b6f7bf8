"""What is known of another car's phase: what it told last, carried on while nothing comes.

    IN_TOUCH       told at most 0.5 s ago
    EXTRAPOLATED   later: it goes on by the plan that it told
    SILENT         its plan has ended: nobody knows where it is

A plan (``member.tell_plan``) is its next places on the curve. They are turned back into phases, so
any car in the room that follows the curve can be a neighbour, whatever program drives it.
"""

from __future__ import annotations

from enum import Enum
from math import inf, pi, remainder
from typing import Protocol

from dart_hal.control.monitoring.course import Course
from dart_hal.core.types import FloatArray

# s, ten messages: as for poses (``dart_hal.fleet``).
STALE = 0.5
# s between two messages at least: two looks at one message differ by rounding.
SAME = 1e-3
# s from point to point of a plan, and points: 3 s, the time for which a phase is carried on.
STEP = 0.25
POINTS = 13


class Touch(str, Enum):
    """How well another car's phase is known."""

    IN_TOUCH = "IN_TOUCH"
    EXTRAPOLATED = "EXTRAPOLATED"
    SILENT = "SILENT"

    def __str__(self) -> str:
        return self.value


class Told(Protocol):
    """A plan as it came (``dart_hal.fleet.peers.OtherPlan``): points (n, 4) of x, y [m], yaw [rad],
    speed [m/s], ``step`` s apart, the first ``age`` s ago."""

    @property
    def age(self) -> float: ...
    @property
    def step(self) -> float: ...
    @property
    def points(self) -> FloatArray: ...


class Peer:
    """One other car; ``hear`` each message, then ask at any later time [s]."""

    def __init__(self, course: Course) -> None:
        self._course = course
        self._t = -inf
        self.heard_at = 0.0
        self.heard_speed = 0.0
        """X [rad] and speed [m/s] that it told of ``t``."""
        self._rate = self._lasts = 0.0

    def hear(self, told: Told, now: float) -> None:
        """A message; one that is older than what is known changes nothing."""
        t = now - told.age
        if t <= self._t + SAME or not len(told.points):
            return
        first = told.points[0]
        last = told.points[-1]
        X = self._course.find(*(float(v) for v in first[:3]))
        if len(told.points) > 1:
            self._lasts = told.step * (len(told.points) - 1)
            on = self._course.find(*(float(v) for v in last[:3]))
            self._rate = ((on - X + pi / 2) % (2.0 * pi) - pi / 2) / self._lasts
        else:
            self._lasts = self._rate = 0.0
        self._t = t
        self.heard_at = X
        self.heard_speed = max(float(first[3]), 0.0)

    def age(self, now: float) -> float:
        """s since what it told last; inf: nothing yet."""
        return now - self._t

    def phase(self, now: float) -> float:
        """X [rad] by what it told, carried on to ``now`` or to the end of its plan."""
        return self.heard_at + self._rate * min(max(self.age(now), 0.0), self._lasts)

    def touch(self, now: float) -> Touch:
        """How well it is known at ``now`` [s]."""
        age = self.age(now)
        if age <= STALE:
            return Touch.IN_TOUCH
        return Touch.EXTRAPOLATED if age <= max(self._lasts, STALE) else Touch.SILENT


def apart(a: float, b: float) -> float:
    """a - b [rad], -pi to pi."""
    return remainder(a - b, 2.0 * pi)
