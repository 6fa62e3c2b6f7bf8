"""Phase of another car: its last report, extrapolated while nothing arrives.

    IN_TOUCH       last message at most 0.5 s ago
    EXTRAPOLATED   later: extrapolated by the plan of the message
    SILENT         its plan has ended: its position is unknown

A plan (``member.tell_plan``) contains its next positions on the curve. They are converted back to
phases, so any car on the curve can be a neighbour, whatever program drives it.
"""

from __future__ import annotations

from math import inf, pi, remainder
from typing import Protocol

from dart_hal.control.monitoring.course import Course
from dart_hal.core.types import FloatArray, TextEnum

# Age up to which a message is recent [s], ten messages: as for poses (``dart_hal.fleet``).
MAX_MESSAGE_AGE = 0.5
# Smallest time between two messages [s]: two readings of one message differ by rounding.
MIN_TIME_STEP = 1e-3
# Time between points of a plan [s], and number of points: 3 s, for which a phase is extrapolated.
PLAN_STEP = 0.25
PLAN_POINTS = 13


class Contact(TextEnum):
    """How well another car's phase is known."""

    IN_TOUCH = "IN_TOUCH"
    EXTRAPOLATED = "EXTRAPOLATED"
    SILENT = "SILENT"


class ReceivedPlan(Protocol):
    """A received plan (``dart_hal.fleet.peers.OtherPlan``): points (n, 4) of x, y [m], yaw [rad],
    speed [m/s], every ``step`` s, the first one ``age`` s ago.
    """

    @property
    def age(self) -> float: ...
    @property
    def step(self) -> float: ...
    @property
    def points(self) -> FloatArray: ...


class Peer:
    """One other car; call ``receive`` with each message, then query any later time [s]."""

    def __init__(self, course: Course) -> None:
        self._course = course
        self._t = -inf
        self.reported_X = 0.0
        self.reported_speed = 0.0
        """X [rad] and speed [m/s] of its last report."""
        self._rate = self._plan_duration = 0.0

    def receive(self, plan: ReceivedPlan, now: float) -> None:
        """Store a message; an older one than the last is ignored."""
        t = now - plan.age
        if t <= self._t + MIN_TIME_STEP or not len(plan.points):
            return
        first = plan.points[0]
        last = plan.points[-1]
        X = self._course.find(*(float(v) for v in first[:3]))
        if len(plan.points) > 1:
            self._plan_duration = plan.step * (len(plan.points) - 1)
            X_end = self._course.find(*(float(v) for v in last[:3]))
            self._rate = ((X_end - X + pi / 2) % (2.0 * pi) - pi / 2) / self._plan_duration
        else:
            self._plan_duration = self._rate = 0.0
        self._t = t
        self.reported_X = X
        self.reported_speed = max(float(first[3]), 0.0)

    def age(self, now: float) -> float:
        """Return the time since its last report [s]; inf: none yet."""
        return now - self._t

    def phase(self, now: float) -> float:
        """Return X [rad] by its report, extrapolated to ``now`` or to the end of its plan."""
        return self.reported_X + self._rate * min(max(self.age(now), 0.0), self._plan_duration)

    def contact(self, now: float) -> Contact:
        """Return how well it is known at ``now`` [s]."""
        age = self.age(now)
        if age <= MAX_MESSAGE_AGE:
            return Contact.IN_TOUCH
        return (
            Contact.EXTRAPOLATED
            if age <= max(self._plan_duration, MAX_MESSAGE_AGE)
            else Contact.SILENT
        )


def phase_difference(a: float, b: float) -> float:
    """Return a - b [rad], -pi to pi."""
    return remainder(a - b, 2.0 * pi)


# Name of version 0.1.
STEP = PLAN_STEP
