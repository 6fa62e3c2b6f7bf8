"""A car of a crossing that shares its plans: from poses and messages to steering and speed.

The alternative to ``Crosser``: no order is agreed on. ``PlanSharer`` decides the course in time;
contouring control steers, and the speed is that of the plan, corrected by the distance to it.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

import numpy as np

from dart_hal.control.crossing.crosser import CrosserCommand, describe_offset
from dart_hal.control.crossing.layout import CrossingLayout
from dart_hal.control.ending import MAX_POSE_GAP, is_located
from dart_hal.control.plant import Plant
from dart_hal.control.shared_plans.planner import PlanSharer
from dart_hal.control.shared_plans.timed_plan import LEVEL_SPEED, MAX_LEVEL, TIME_STEP
from dart_hal.control.trackers import contouring
from dart_hal.core.types import FloatArray, MotionEstimate, TextEnum

# Period of the messages [s]: a quarter of an answer's 0.2 s, five control steps.
PLAN_MESSAGE_PERIOD = 0.05
# Time from the speed of the plan to that of the wheels [s], and speed per distance to the plan
# [1/s]: with both a car is at most 7.1 cm from its plan (docs/results/distributed_plans.md).
SPEED_DELAY = 0.15
PROGRESS_GAIN = 2.0
# Target speed up to which a car at rest stays there [m/s]: it does not roll slower. Correction at
# most [m/s]: that of a deviation of 0.15 m, below the limit of the drive.
MIN_PLAN_SPEED = 0.05
MAX_CORRECTION = 0.3
# Distance from the plan at which the drive ends [m]: the others no longer know where the car is.
MAX_DEVIATION = 0.2
# Points of a shared plan, one each 0.1 s.
POINTS = 32


class PlanWait(TextEnum):
    """GOING: by the plan; WAITING: at rest until a proposal is adopted; DONE: at the end."""

    GOING = "GOING"
    WAITING = "WAITING_FOR_A_PLAN"
    DONE = "DONE"


class PlanCrosser:
    """Call ``answer`` once per State. ``why``: reason of the end, or ""; ``deviation`` [m]: largest
    distance along the path to the plan; ``events``: (t, wait) at each change.
    """

    def __init__(
        self, sharer: PlanSharer, layout: CrossingLayout, route: str, plant: Plant
    ) -> None:
        """sharer: of the paths of all cars of the layout."""
        self.sharer = sharer
        self.plant = plant
        self.route = layout.number(route)
        self.path = layout.routes[self.route].path
        self.tracker = contouring(self.path, plant)
        self.tracker.pace = lambda s: max(self._target_speed, MIN_PLAN_SPEED)
        self.wait = PlanWait.WAITING
        self.events: list[tuple[float, PlanWait]] = []
        self.why = ""
        self.deviation = 0.0
        self._end = layout.exit[self.route]
        self._centre_offset = plant.vehicle.body.l_r  # from the rear axle to the centre of the body
        self._target_speed = 0.0
        self._next_message_t = -inf
        self._located_t = -inf
        self._has_begun = False
        self._t = 0.0

    @property
    def s(self) -> float:
        """Arc length of the centre of the body [m]."""
        return self.tracker.s + self._centre_offset

    @property
    def is_done(self) -> bool:
        """Whether the car has passed the common ground."""
        return self.s > self._end

    def answer(
        self, motion: MotionEstimate, datagrams: Iterable[tuple[bytes, float]], free: float = inf
    ) -> CrosserCommand:
        """Return the command at ``motion.t``.

        datagrams: received bytes and the age of each [s]; free: not used, as plans are shared.
        """
        t = motion.t
        self._t = t
        for data, age in datagrams:
            self.sharer.receive(data, t, age)
        if is_located(motion):
            if not self._has_begun:
                pose = motion.pose
                self.tracker.begin(self.path.nearest(pose.x, pose.y))
                self._has_begun = True
            self._located_t = t
        if not self._has_begun:
            return CrosserCommand(0.0, 0.0, b"")
        message = b""
        if t > self._next_message_t - 1e-6:
            self._next_message_t = t + PLAN_MESSAGE_PERIOD
            self.sharer.step(t)
            message = self.sharer.next_message(t)
        speed = self._follow_plan(t)
        steering = self.tracker.steer(motion)
        self.why = self.why or self.tracker.why or describe_offset(self.tracker.offset)
        if self.why or t - self._located_t > MAX_POSE_GAP:
            speed = 0.0
        return CrosserCommand(steering, speed, message)

    @property
    def log_values(self) -> dict[str, float]:
        """Values for ``car.log``: distance to the plan [m], target speed [m/s], proposals."""
        counts = self.sharer.counts
        return {
            "deviation": self.sharer.motion_at(self._t)[0] - self.s,
            "target_speed": self._target_speed,
            "proposed": float(counts["PROPOSED"]),
            "adopted": float(counts["ADOPTED"]),
        }

    def points(self) -> FloatArray:
        """Return the plan for ``Member.tell_plan``: (n, 4) of x, y [m], yaw [rad], speed [m/s]."""
        rows = []
        for k in range(POINTS):
            s, speed, _ = self.sharer.motion_at(self._t + 0.1 * k)
            point = self.path.interpolate(s - self._centre_offset)
            rows.append((point.x, point.y, point.heading, speed))
        return np.array(rows)

    def _follow_plan(self, t: float) -> float:
        """Return the speed [m/s] for the plan, and check the distance to it."""
        plan_s, _, _ = self.sharer.motion_at(t)
        _, coming, _ = self.sharer.motion_at(t + SPEED_DELAY)
        error = plan_s - self.s
        self.deviation = max(self.deviation, abs(error))
        if abs(error) > MAX_DEVIATION:
            self.why = self.why or f"{abs(error):.2f} m from the plan that was shared"
        correction = min(max(PROGRESS_GAIN * error, -MAX_CORRECTION), MAX_CORRECTION)
        self._target_speed = min(max(coming + correction, 0.0), MAX_LEVEL * LEVEL_SPEED + 0.1)
        # At the end of the plan the car stays, unless it stopped before the place of the plan.
        is_ended = self.sharer.committed.end_t < t + TIME_STEP
        if is_ended and coming == 0.0 and correction < MIN_PLAN_SPEED:
            self._target_speed = 0.0
        wait = PlanWait.DONE if self.is_done else PlanWait.WAITING if is_ended else PlanWait.GOING
        if wait is not self.wait or not self.events:
            self.wait = wait
            self.events.append((t, wait))
        return self._target_speed
