"""A planner as a tracker: a plan each 0.1 s, whose first steering is held until the next.

The plan begins at the pose that is predicted for the time at which its answer acts, with the
model's slip there. The car's speed loop drives: it is given the speed that the plan has a little
later, where that is less than the profile's. A plan that is late is the last one, shifted; too
many of them in a row (``driving.LATEST``), one that diverged or one without a way past the
obstacles end the drive (``why``): ``safe`` steers to rest.

What the car passes is given as discs; how near it came to each, by its own estimate, is in ``air``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import cos, inf, sin
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from dart_hal.control.mpc.disturbance import Learning
from dart_hal.control.mpc.driving import (
    BUDGET,
    REACH,
    first_state,
    inputs_of,
    vehicle_of,
    why_of,
)
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.obstacles import Disc, Obstacle, air, needed
from dart_hal.control.mpc.planner import Outcome, Plan, Planner
from dart_hal.control.mpc.problem import GRIP, Limits
from dart_hal.control.mpc.spread import across
from dart_hal.control.on_path import OnPath
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.steady import SPEEDS
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, MotionEstimate

# m to either side.
LANE = 0.3
# m to the end of the lane that a way past an obstacle has to leave: a drive ends there, and the
# car errs by 2 to 3 cm beside one.
EDGE = 0.04
# Plans from one that is kept to be drawn to the next: 1 s.
SHOWN = 10
# How a plan came about, by its place, as it is recorded.
OUTCOMES = tuple(Outcome)

PlannerT = TypeVar("PlannerT", bound=Planner[Any])


class Shown(NamedTuple):
    """A plan to be drawn: x, y [m] of its states and how sure they are across [m], (n + 1,)."""

    x: FloatArray
    y: FloatArray
    std: FloatArray


class Contouring(OnPath, Generic[PlannerT]):
    """See ``Tracker``. ``mpcc``: the planner, its obstacles may be set; ``plan``: the last;
    ``shown``: one of ten; ``air`` [m]: the least beside each disc; ``in_numpy``: why there is no C.
    """

    def __init__(self, path: Path, plant: Plant, safe: OnPath, make: Callable[..., PlannerT],
                 discs: tuple[Disc, ...] = (), lane: float = LANE) -> None:
        """make: the planner of a vehicle, a path, the speed that is wanted there, and limits;
        discs: what is to be passed, from the first answer on; lane [m] to either side. Raises
        UsageError as the planner."""
        super().__init__(path, plant)
        self._vehicle = vehicle_of(plant)
        self.mpcc = make(self._vehicle, path, self._paces, replace(_limits(plant), lane=lane))
        self.in_numpy = ""
        self.discs = discs
        self.air = [inf] * len(discs)
        self._still: tuple[Obstacle, ...] = ()
        self.shown: list[Shown] = []
        self.mpcc.budget = BUDGET
        self.plan: Plan | None = None
        self._prediction = self._learning = Learning(plant)
        self._safe = safe
        self._safe._prediction = self._prediction
        self._due = -inf
        self._st = 0.0
        self._missed = 0
        self._count = 0

    def begin(self, s: float) -> None:
        """See ``Tracker``. Raises UsageError for a disc that leaves no way within the lane."""
        super().begin(s)
        self._safe.begin(s)
        for k, disc in enumerate(self.discs, start=1):
            _passable(k, disc, disc.beside(self.path, 0.0), self.mpcc.limits.lane)
        self.mpcc.reset()
        self.mpcc.clock = self.clock
        self.plan = None
        self._due = -inf
        self._missed = 0
        self._count = 0
        self._st = self.plant.command_of(0.0)

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        pose = motion.pose
        self.s = self.path.closest(pose.x, pose.y, self.s)
        self.offset = self.path.offset(pose.x, pose.y, self.s)
        self.told = {}
        self._prediction.see(motion)
        self._watch(motion)
        if self.why:
            return self._safe.steer(motion)
        if motion.t > self._due - 1e-6:
            self._due = motion.t + STAGE
            self.plan = self._planned(motion)
            self.told = {"outcome": np.array([float(OUTCOMES.index(self.plan.outcome))])}
            if self.why:
                return self._safe.steer(motion)
            self._st = self._learning.disturbance.command(float(self.plan.inputs[1, 0]))
            x, y, _, speed = self.plan.states[:, :4].T
            std = across(self.plan, motion.cov)
            self.told |= {"x": x, "y": y, "speed": speed, "throttle": self.plan.inputs[0],
                          "steering": self.plan.inputs[1], "std": std}
            if self._count % SHOWN == 0:
                self.shown.append(Shown(x, y, std))
            self._count += 1
        if self.plan is not None:
            self.speed = float(self.plan.at(motion.t + REACH)[3])
        return self._turned(motion)

    def pass_by(self, others: tuple[Obstacle, ...]) -> None:
        """What is to be passed from now on, beside the discs."""
        self.mpcc.obstacles = (*self._still, *others)

    def _watch(self, motion: MotionEstimate) -> None:
        """The discs begin to move with the first answer; how near the body is to each."""
        if self.discs and not self._still:
            self._still = tuple(d.beside(self.path, motion.t) for d in self.discs)
            self.pass_by(())
        pose = motion.pose
        ahead = self._vehicle.body.l_r
        x = pose.x + ahead * cos(pose.yaw)
        y = pose.y + ahead * sin(pose.yaw)
        for k, o in enumerate(self._still):
            self.air[k] = min(self.air[k], air(x, y, pose.yaw, o, self.path, motion.t))

    def _turned(self, motion: MotionEstimate) -> float:
        """The angle [rad] of the command that is in force."""
        low, high = self.plant.lock
        angle = min(max(self.plant.angle_of(self._st), low), high)
        self._prediction.sent(motion.t, angle)
        return angle

    def _planned(self, motion: MotionEstimate) -> Plan:
        """The plan from the time on at which it acts; ``why`` where there is none to drive by."""
        where, s = self._see(motion, self.plant.late.transport)
        plan = self.plan
        tau = float(plan.at(where.t)[6]) if plan else self.mpcc.limits.tau[0]
        acts = self._learning.disturbance.effective
        state = first_state(self.plant, where, self._vehicle.body.l_r, tau, acts(where.servo))
        sent = float(plan.inputs[0, 0]) if plan else tau
        low, high = self.mpcc.limits.st
        self.mpcc.turn_within(acts(low), acts(high))
        found: Plan = self.mpcc.plan(where.t, state, s, (sent, acts(self._st)))
        self._missed = self._missed + 1 if found.outcome is Outcome.LATE else 0
        self.why = why_of(found.outcome, self._missed)
        return found

    def _paces(self, s: FloatArray) -> FloatArray:
        return np.array([self.pace(float(at)) for at in s])


def _passable(k: int, disc: Disc, o: Obstacle, lane: float) -> None:
    """Raises UsageError for an obstacle that no plan passes within the lane."""
    room = needed(o) + EDGE
    if room > lane:
        side = "left" if o.offset > 0.0 else "right"
        raise UsageError(
            f"obstacle {k} leaves no way within the lane",
            found=f"{abs(o.offset):.2f} m to the {side} of the path at {o.s:.2f} m, radius "
                  f"{disc.radius:g} m: the car would have to go {needed(o):.2f} m beside the path",
            expected=f"{EDGE:g} m less than the lane of {lane:g} m to either side",
            remedy=f"--lane {room + 0.005:.2f} where there is room, or move the obstacle")


def _limits(plant: Plant) -> Limits:
    """Of the car: dead band, stops, most throttle; tyres by the model."""
    ends = np.abs(plant.steady.ends) * SPEEDS**2
    return Limits(*inputs_of(plant), lateral=GRIP * float(ends.max(axis=1).min()))
