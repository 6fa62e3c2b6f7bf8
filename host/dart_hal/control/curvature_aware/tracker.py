"""The two layers as a tracker of ``control.follow``: a plan each 0.1 s, its first steering held.

The car's speed loop drives, by the speed that the plan has a little later. The plan begins where
the car will be when its answer acts, by the commands on their way. What ends a drive is what ends
that of ``mpc.tracker``; ``safe`` then steers to rest.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from dart_hal.control.curvature_aware.two_layers import TwoLayerPlan, TwoLayers
from dart_hal.control.mpc.driving import (
    BUDGET,
    REACH,
    first_state,
    inputs_of,
    vehicle_of,
    why_of,
)
from dart_hal.control.mpc.iteration import Outcome
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.problem import Limits
from dart_hal.control.on_path import OnPath
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.types import FloatArray, MotionEstimate


class TwoLayerTracker(OnPath):
    """See ``Tracker``. layers: the controller, its obstacles may be set; ``plan``: the last."""

    def __init__(self, path: Path, plant: Plant, safe: OnPath, **options: Any) -> None:
        """options: of ``TwoLayers``; published: a plant of kind "kinematic" without lags."""
        super().__init__(path, plant)
        vehicle = vehicle_of(plant)
        self.layers = TwoLayers(vehicle, path, self._paces, Limits(*inputs_of(plant)), **options)
        self.layers.budget = BUDGET
        self.plan: TwoLayerPlan | None = None
        self._l_r = vehicle.body.l_r
        self._safe = safe
        self._safe._prediction = self._prediction
        self._due, self._st, self._missed = -inf, 0.0, 0

    def begin(self, s: float) -> None:
        """See ``Tracker``."""
        super().begin(s)
        self._safe.begin(s)
        self.layers.reset()
        self.layers.clock = self.clock
        self.plan, self._due, self._missed = None, -inf, 0
        self._st = self.plant.command_of(0.0)

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        pose = motion.pose
        self.s = self.path.closest(pose.x, pose.y, self.s)
        self.offset = self.path.offset(pose.x, pose.y, self.s)
        self.told = {}
        if not self.why and motion.t > self._due - 1e-6:
            self._due = motion.t + STAGE
            self.plan = plan = self._planned(motion)
            self._st = float(plan.inputs[1, 0])
            x, y, _, speed = plan.states[:, :4].T
            self.told = {"x": x, "y": y, "speed": speed, "throttle": plan.inputs[0],
                         "steering": plan.inputs[1]}
        if self.why:
            return self._safe.steer(motion)
        if self.plan is not None:
            self.speed = float(self.plan.at(motion.t + REACH)[3])
        return self._command(motion, self.plant.angle_of(self._st))

    def _planned(self, motion: MotionEstimate) -> TwoLayerPlan:
        """The plan from the time on at which it acts; ``why`` where there is none to drive by."""
        where, s = self._see(motion, self.plant.late.transport)
        tau = float(self.plan.at(where.t)[6]) if self.plan else self.layers.limits.tau[0]
        state = first_state(self.plant, where, self._l_r, tau, self.plant.command_of(where.angle))
        found = self.layers.plan(where.t, state, s, (tau, self._st))
        self._missed = self._missed + 1 if found.outcome is Outcome.LATE else 0
        self.why = why_of(found.outcome, self._missed)
        return found

    def _paces(self, s: FloatArray) -> FloatArray:
        return np.array([self.pace(float(at)) for at in s])
