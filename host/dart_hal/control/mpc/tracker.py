"""Contouring control as a tracker: a plan each 0.1 s, whose first steering is held until the next.

The plan begins at the pose that is predicted for the time at which its answer acts, with the
model's slip there. The car's speed loop drives: it is given the speed that the plan has a little
later, where that is less than the profile's. A plan that is late is the last one, shifted; more
than ``LATEST`` of them in a row, one that diverged or one without a way past the obstacles end the
drive (``why``): ``safe`` steers to rest.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, tan

import numpy as np

from dart_hal.control.mpc.disturbance import Learning
from dart_hal.control.mpc.iteration import Mpcc, Outcome, Plan
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.problem import Limits
from dart_hal.control.on_path import OnPath
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.steady import SPEEDS
from dart_hal.types import FloatArray, MotionEstimate
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.parameters import Delay

BUDGET, LATEST = 0.05, 3
"""s for a plan, half of what there is; late ones in a row that are still as good as the model."""
REACH = 0.3
"""s ahead of which the plan's speed is asked for: what the speed loop takes to answer, and some."""
GRIP = 0.8
"""Of the most that the tyres hold across, by the model."""


class Contouring(OnPath):
    """See ``Tracker``. ``mpcc``: the controller, its obstacles may be set; ``plan``: the last."""

    def __init__(self, path: Path, plant: Plant, safe: OnPath) -> None:
        super().__init__(path, plant)
        p, late = settled(plant.vehicle), plant.late
        lag = p.delay.throttle_lag_s if late.lag or late.transport else 0.0
        self._vehicle = replace(p, delay=Delay(steering_lag_s=late.lag, throttle_lag_s=lag))
        self.mpcc = Mpcc(self._vehicle, path, self._paces, _limits(plant))
        self.mpcc.budget = BUDGET
        self.plan: Plan | None = None
        self._prediction = self._learning = Learning(plant)
        self._safe = safe
        self._safe._prediction = self._prediction
        self._due, self._st, self._missed = -inf, 0.0, 0

    def begin(self, s: float) -> None:
        """See ``Tracker``."""
        super().begin(s)
        self._safe.begin(s)
        self.mpcc.reset()
        self.mpcc.clock = self.clock
        self.plan, self._due, self._missed = None, -inf, 0
        self._st = self.plant.command_of(0.0)

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        pose = motion.pose
        self.s = self.path.closest(pose.x, pose.y, self.s)
        self.offset = self.path.offset(pose.x, pose.y, self.s)
        self.told = {}
        if self.why:
            return self._safe.steer(motion)
        if motion.t > self._due - 1e-6:
            self._due = motion.t + STAGE
            self.plan = self._planned(motion)
            if self.why:
                return self._safe.steer(motion)
            self._st = self._learning.disturbance.command(float(self.plan.inputs[1, 0]))
            x, y, _, speed = self.plan.states[:, :4].T
            self.told = {"x": x, "y": y, "speed": speed, "throttle": self.plan.inputs[0],
                         "steering": self.plan.inputs[1]}
        if self.plan is not None:
            self.speed = float(self.plan.at(motion.t + REACH)[3])
        return self._turned(motion)

    def _turned(self, motion: MotionEstimate) -> float:
        """The angle [rad] of the command that is in force."""
        low, high = self.plant.lock
        angle = min(max(self.plant.angle_of(self._st), low), high)
        self._prediction.sent(motion.t, angle)
        return angle

    def _planned(self, motion: MotionEstimate) -> Plan:
        """The plan from the time on at which it acts; ``why`` where there is none to drive by."""
        where, s = self._see(motion, self.plant.late.transport)
        speed, plan = max(where.speed, 0.0), self.plan
        steady, l_r = self.plant.steady, self._vehicle.body.l_r
        bend = steady.bend(where.angle, speed)
        omega, slip = bend * speed, steady.turn(bend, speed).slip
        tau = float(plan.at(where.t)[6]) if plan else self.mpcc.limits.tau[0]
        acts = self._learning.disturbance.effective
        state = np.array((where.x, where.y, where.yaw, speed, l_r * omega + speed * tan(slip),
                          omega, tau, acts(where.servo)))
        sent = float(plan.inputs[0, 0]) if plan else tau
        low, high = self.mpcc.limits.st
        self.mpcc.problem.turn_within(acts(low), acts(high))
        found = self.mpcc.plan(where.t, state, s, (sent, acts(self._st)))
        self._missed = self._missed + 1 if found.outcome is Outcome.LATE else 0
        if found.outcome is Outcome.DIVERGED:
            self.why = "the plan diverged"
        elif found.outcome is Outcome.BLOCKED:
            self.why = "obstacles leave no way within the lane"
        elif self._missed > LATEST:
            self.why = f"no plan within {BUDGET:g} s, {self._missed} times in a row"
        return found

    def _paces(self, s: FloatArray) -> FloatArray:
        return np.array([self.pace(float(at)) for at in s])


def _limits(plant: Plant) -> Limits:
    """Of the car: dead band, stops, most throttle; tyres by the model."""
    ends = np.abs(plant.steady.ends) * SPEEDS**2
    low, high = (plant.command_of(angle) for angle in plant.lock)
    onset = -plant.vehicle.motor.g
    return Limits((onset, max(plant.throttle, onset + 0.1)), (low, high),
                  lateral=GRIP * float(ends.max(axis=1).min()))
