"""A car of a crossing: from poses and messages to steering, speed and the next message.

Contouring control plans along the route and stops before the coordinator's line; its target speed
is that from which the car still stops there. If its plan fails, the drive ends: ``why``.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.crossing.coordinator import Coordinator, CrossingWait, StopLine
from dart_hal.control.crossing.order import CrossingPhase, MessageVerdict
from dart_hal.control.crossing.speed import safe_speed
from dart_hal.control.ending import MAX_POSE_GAP, is_located
from dart_hal.control.mpc.tracker import DEFAULT_HALF_WIDTH
from dart_hal.control.plant import Plant
from dart_hal.control.trackers import contouring
from dart_hal.core.types import FloatArray, MotionEstimate

# Period of the messages [s].
MESSAGE_PERIOD = 0.1
# Target speeds below the first are replaced by rest, 4 cm before the line; a car at rest starts
# above the second, when the line is 0.2 m away: noise causes no pulse [m/s].
MIN_TARGET_SPEED = 0.1
MIN_START_SPEED = 0.3

def describe_offset(offset: float) -> str:
    """Return why a car with this distance to its route [m] must stop, or "".

    The other cars count on its route.
    """
    return f"{abs(offset):.2f} m from its route" if abs(offset) > DEFAULT_HALF_WIDTH else ""


class CrosserCommand(NamedTuple):
    """steering [rad], speed [m/s]; message to send now, b"" = none."""

    steering: float
    speed: float
    message: bytes


class Crosser:
    """Call ``answer`` once per State. ``last``: stop line and reason; ``why``: reason of the end,
    or "".
    """

    def __init__(self, coordinator: Coordinator, plant: Plant) -> None:
        self.coordinator = coordinator
        self.plant = plant
        self.path = coordinator.layout.routes[coordinator.route].path
        self.tracker = contouring(self.path, self.plant)
        self.tracker.pace = self._target_speed_at
        self.last = StopLine(inf, CrossingWait.GOING, "")
        self._centre_offset = plant.vehicle.body.l_r  # from the rear axle to the centre of the body
        self._next_message_t = -inf
        self._located_t = -inf
        self._has_begun = False
        self._is_waiting = True
        self._off_route = ""

    @property
    def s(self) -> float:
        """Arc length of the centre of the body [m]."""
        return self.tracker.s + self._centre_offset

    @property
    def route(self) -> int:
        """Number of the route."""
        return self.coordinator.route

    @property
    def is_done(self) -> bool:
        """Whether the car has passed the common ground."""
        return self.coordinator.phase is CrossingPhase.DONE

    @property
    def wait(self) -> CrossingWait:
        """Why the car is slower than its target speed."""
        return self.last.wait

    @property
    def events(self) -> list[tuple[float, CrossingWait, str]]:
        """Time, reason and car of each change of ``wait``."""
        return self.coordinator.events

    @property
    def why(self) -> str:
        """Reason of the end, or ""."""
        return self.tracker.why or self._off_route

    def answer(
        self, motion: MotionEstimate, datagrams: Iterable[tuple[bytes, float]], free: float = inf
    ) -> CrosserCommand:
        """Return the command at ``motion.t``.

        datagrams: received bytes and the age of each [s]; free [m]: distance to the centre of the
        car ahead in its lane.
        """
        t = motion.t
        pose = motion.pose
        for data, age in datagrams:
            self.coordinator.receive(data, t, age)
        if is_located(motion):
            if not self._has_begun:
                self.tracker.begin(self.path.nearest(pose.x, pose.y))
                self._has_begun = True
            self._located_t = t
        if not self._has_begun:
            # Others would wait for a car at the origin, or pass before it.
            return CrosserCommand(0.0, 0.0, b"")
        message = b""
        if t > self._next_message_t - 1e-6:
            self._next_message_t = t + MESSAGE_PERIOD
            self.last = self.coordinator.step(t, self.s, free)
            self.tracker.mpcc.stop_line = self.last.line - self._centre_offset
            message = self.coordinator.next_message()
        steering = self.tracker.steer(motion)
        target_speed = self._target_speed_at(self.tracker.s)
        speed = min(self.tracker.speed, target_speed)
        self._is_waiting = speed < MIN_TARGET_SPEED or (
            self._is_waiting and target_speed < MIN_START_SPEED
        )
        self._off_route = self._off_route or describe_offset(self.tracker.offset)
        if self._is_waiting or self.why or t - self._located_t > MAX_POSE_GAP:
            speed = 0.0
        return CrosserCommand(steering, speed, message)

    @property
    def log_values(self) -> dict[str, float]:
        """Values for ``car.log``.

        line [m]: at most the end of the path; wait: number in ``CrossingWait``; who: number of the
        car that it waits for, -1 = none; phase; taken, refused: numbers of messages.
        """
        coordinator = self.coordinator
        last = self.last
        taken = coordinator.counts[MessageVerdict.TAKEN.value]
        return {
            "line": min(last.line, self.path.length),
            "wait": float(list(CrossingWait).index(last.wait)),
            "who": float(coordinator.names.index(last.who)) if last.who else -1.0,
            "phase": float(coordinator.phase),
            "taken": float(taken),
            "refused": float(coordinator.counts.total() - taken - coordinator.counts["OLD"]),
        }

    def points(self) -> FloatArray:
        """Return the plan for ``Member.tell_plan``: (n, 4) of x, y [m], yaw [rad], speed [m/s]."""
        plan = self.tracker.plan
        return np.empty((0, 4)) if plan is None else plan.states[:, :4]

    def _target_speed_at(self, s: float) -> float:
        """Return the target speed [m/s] with the rear axle at s [m]."""
        line = min(self.last.line, self.path.length)
        return min(self.coordinator.layout.speed, float(safe_speed(line - self._centre_offset - s)))
