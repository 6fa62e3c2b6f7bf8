"""A car of a crossing: from poses and messages to steering, speed and the next message.

Contouring control plans along the route and stands before the coordinator's line; its wanted speed
is that from which the car still stops there. What ends its plan ends the drive: ``why``.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.crossing.coordinator import Answer, Coordinator, Wait
from dart_hal.control.crossing.order import Verdict
from dart_hal.control.crossing.speed import safe_speed
from dart_hal.control.plant import Plant
from dart_hal.control.trackers import contouring
from dart_hal.core.types import FloatArray, MotionEstimate, Tracking

# s from one message to the next.
EVERY = 0.1
# m/s: slower than that is asked for as rest, 4 cm before the line; a car at rest starts for no
# less, when the line is 0.2 m away: for noise it gives no pulse.
STANDS = 0.1
STARTS = 0.3
# s without a pose after which the car stops.
BLIND = 0.5


class Command(NamedTuple):
    """steering [rad], speed [m/s]; message to send now, b"" = none."""

    steering: float
    speed: float
    message: bytes


class Crosser:
    """``answer`` once per State. ``last``: where it has to stand, and why; ``why`` it gave up, ""
    = it did not."""

    def __init__(self, coordinator: Coordinator, plant: Plant) -> None:
        self.coordinator = coordinator
        self.plant = plant
        self.path = coordinator.layout.routes[coordinator.route].path
        self.tracker = contouring(self.path, self.plant)
        self.tracker.pace = self._pace
        self.last = Answer(inf, Wait.GOING, "")
        self._ahead = plant.vehicle.body.l_r  # of the car's middle before its rear axle
        self._due = -inf
        self._seen = -inf
        self._begun = False
        self._stands = True

    @property
    def s(self) -> float:
        """Of the car's middle [m]."""
        return self.tracker.s + self._ahead

    @property
    def why(self) -> str:
        """Why it gave up."""
        return self.tracker.why

    def answer(
        self, motion: MotionEstimate, came: Iterable[tuple[bytes, float]], free: float = inf
    ) -> Command:
        """What to command at ``motion.t``.

        came: bytes of messages and how old each is [s]; free [m]: to the middle of the car ahead
        in its lane.
        """
        t = motion.t
        pose = motion.pose
        if not self._begun:
            near = float(np.argmin(np.hypot(self.path.x - pose.x, self.path.y - pose.y)))
            self.tracker.begin(near * self.path.spacing)
            self._begun = True
        if motion.tracking is Tracking.TRACKING:
            self._seen = t
        for data, age in came:
            self.coordinator.hear(data, t, age)
        message = b""
        if t > self._due - 1e-6:
            self._due = t + EVERY
            self.last = self.coordinator.step(t, self.s, free)
            self.tracker.mpcc.line = self.last.line - self._ahead
            message = self.coordinator.tell()
        steering = self.tracker.steer(motion)
        pace = self._pace(self.tracker.s)
        speed = min(self.tracker.speed, pace)
        self._stands = speed < STANDS or (self._stands and pace < STARTS)
        if self._stands or self.why or t - self._seen > BLIND:
            speed = 0.0
        return Command(steering, speed, message)

    @property
    def told(self) -> dict[str, float]:
        """For ``car.log``: line [m], at most the path's end; wait, by its place in ``Wait``; who it
        waits for, by the roster, -1 = nobody; phase; messages taken, and those that were not."""
        mind = self.coordinator
        last = self.last
        taken = mind.counts[Verdict.TAKEN.value]
        return {
            "line": min(last.line, self.path.length),
            "wait": float(list(Wait).index(last.wait)),
            "who": float(mind.names.index(last.who)) if last.who else -1.0,
            "phase": float(mind.phase),
            "taken": float(taken),
            "refused": float(mind.counts.total() - taken - mind.counts["OLD"]),
        }

    def points(self) -> FloatArray:
        """The plan for ``Member.tell_plan``: (n, 4) of x, y [m], yaw [rad], speed [m/s]."""
        plan = self.tracker.plan
        return np.empty((0, 4)) if plan is None else plan.states[:, :4]

    def _pace(self, s: float) -> float:
        """m/s that are wanted with the rear axle at s [m]."""
        line = min(self.last.line, self.path.length)
        return min(self.coordinator.layout.speed, float(safe_speed(line - self._ahead - s)))
