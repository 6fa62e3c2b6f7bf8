"""A planner as a tracker: a plan every 0.1 s, whose first steering command holds until the next.

The plan begins at the pose predicted for the time at which its inputs act, with the slip of the
model. The car's speed loop drives: its setpoint is the speed of the plan a little later, where that
is less than that of the profile. A late plan is replaced by the last one, shifted. Too many late
plans in a row (``driving.MAX_LATE_PLANS``), a plan that diverges or one without a passage between
obstacles end the drive (``why``): ``fallback`` steers along the last plan until the car is at rest.
On the path itself it could hit an obstacle that is being passed.

Obstacles are given as discs; ``air`` holds the smallest clearance to each, by the car's estimate.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from math import cos, inf, pi, remainder, sin
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from dart_hal.control.mpc.disturbance import DisturbancePrediction
from dart_hal.control.mpc.driving import (
    PLAN_BUDGET,
    SPEED_LOOKAHEAD,
    brake_range,
    describe_failure,
    input_ranges,
    make_first_state,
    make_planning_vehicle,
)
from dart_hal.control.mpc.model import STAGE_PERIOD
from dart_hal.control.mpc.obstacles import (
    HALF_WIDTH,
    LATERAL_MARGIN,
    OBSTACLE_LANE_MARGIN,
    Disc,
    Obstacle,
    clearance,
    required_offset,
)
from dart_hal.control.mpc.planner import MpcPlan, MpcPlanner, PlanOutcome
from dart_hal.control.mpc.problem import TYRE_SHARE, MpcLimits
from dart_hal.control.mpc.spread import lateral_std
from dart_hal.control.on_path import PathTracker
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.steady import SPEEDS
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, MotionEstimate

# Lane to either side [m].
DEFAULT_HALF_WIDTH = 0.3
# Plans from one that is stored for the picture to the next: 1 s.
PLANS_PER_PREDICTION = 10
# Predictions that are kept: those of ten minutes, 0.4 MB.
MAX_PREDICTIONS = 600
# Outcomes in the order by which they are recorded.
PLAN_OUTCOMES = tuple(PlanOutcome)

# Arc length, offset and heading error of the path itself.
_ON_PATH = (np.zeros(1), np.zeros(1), np.zeros(1))

PlannerT = TypeVar("PlannerT", bound=MpcPlanner[Any])


class PredictedPath(NamedTuple):
    """A plan for the picture: x, y [m] of its states and their lateral std [m], (n + 1,)."""

    x: FloatArray
    y: FloatArray
    std: FloatArray


class Contouring(PathTracker, Generic[PlannerT]):
    """See ``Tracker``. ``mpcc``: the planner, its obstacles may be set; ``plan``: the last plan;
    ``predictions``: every tenth plan, the newest of them; ``air`` [m]: smallest clearance to each
    disc; ``compile_error``: why the plans are not made in C.
    """

    def __init__(
        self,
        path: Path,
        plant: Plant,
        fallback: PathTracker,
        make: Callable[..., PlannerT],
        discs: tuple[Disc, ...] = (),
        lane: float = DEFAULT_HALF_WIDTH,
    ) -> None:
        """make: constructs the planner of a vehicle, a path, the target speed and limits; discs: to
        be passed, they move from the first plan on; lane [m] to either side. Raises UsageError as
        the planner.
        """
        super().__init__(path, plant)
        self._vehicle = make_planning_vehicle(plant)
        self.mpcc = make(
            self._vehicle, path, self._target_speeds, replace(_limits(plant), lane=lane)
        )
        self.compile_error = ""
        self.discs = discs
        self.air = [inf] * len(discs)
        self._disc_obstacles: tuple[Obstacle, ...] = ()
        self._disc_numbers: list[int] = []
        self.predictions: deque[PredictedPath] = deque(maxlen=MAX_PREDICTIONS)
        self.mpcc.budget = PLAN_BUDGET
        self.plan: MpcPlan | None = None
        prediction = DisturbancePrediction(plant)
        self._prediction = prediction
        # The estimate of this prediction; ``steer`` updates it.
        self._disturbance = prediction.disturbance
        self._fallback = fallback
        self._fallback._prediction = prediction
        self._next_plan_t = -inf
        self._st = 0.0
        self._late_plans = 0
        self._plan_count = 0
        self._last_course = _ON_PATH

    def begin(self, s: float) -> None:
        """See ``Tracker``. Raises UsageError for a disc that leaves no passage within the lane."""
        super().begin(s)
        self._fallback.begin(s)
        for k, disc in enumerate(self.discs, start=1):
            for obstacle in disc.locate(self.path, 0.0, self._reach(disc)):
                _check_passable(k, disc, obstacle, self.mpcc.limits.lane)
        self.mpcc.reset()
        self.mpcc.clock = self.clock
        self.plan = None
        self._next_plan_t = -inf
        self._late_plans = 0
        self._plan_count = 0
        self._last_course = _ON_PATH
        self._st = self.plant.command_of(0.0)

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        pose = motion.pose
        self.s = self.path.closest(pose.x, pose.y, self.s)
        self.offset = self.path.offset(pose.x, pose.y, self.s)
        self.plan_log = {}
        self._prediction.update(motion)
        self._measure_clearance(motion)
        if self.why:
            return self._steer_by_fallback(motion)
        if motion.t > self._next_plan_t - 1e-6:
            self._next_plan_t = motion.t + STAGE_PERIOD
            self.plan = self._make_plan(motion)
            self.plan_log = {"outcome": np.array([float(PLAN_OUTCOMES.index(self.plan.outcome))])}
            if self.why:
                return self._steer_by_fallback(motion)
            self._st = self._disturbance.command(float(self.plan.inputs[1, 0]))
            x, y, _, speed = self.plan.states[:, :4].T
            std = lateral_std(self.plan, motion.cov)
            self.plan_log |= {"x": x, "y": y, "speed": speed, "throttle": self.plan.inputs[0],
                          "steering": self.plan.inputs[1], "std": std}
            if self._plan_count % PLANS_PER_PREDICTION == 0:
                self.predictions.append(PredictedPath(x, y, std))
            self._plan_count += 1
        if self.plan is not None:
            self.speed = max(float(self.plan.state_at(motion.t + ahead)[3])
                             for ahead in (0.0, SPEED_LOOKAHEAD))
        return self._hold_steering(motion)

    def set_moving_obstacles(self, others: tuple[Obstacle, ...]) -> None:
        """Set the obstacles in addition to the discs."""
        self.mpcc.obstacles = (*self._disc_obstacles, *others)

    def _measure_clearance(self, motion: MotionEstimate) -> None:
        """Start the motion of the discs with the first call; update the clearances."""
        if self.discs and not self._disc_obstacles:
            by_disc = [d.locate(self.path, motion.t, self._reach(d)) for d in self.discs]
            self._disc_obstacles = tuple(o for found in by_disc for o in found)
            self._disc_numbers = [k for k, found in enumerate(by_disc) for _ in found]
            self.set_moving_obstacles(())
        pose = motion.pose
        l_r = self._vehicle.body.l_r
        x = pose.x + l_r * cos(pose.yaw)
        y = pose.y + l_r * sin(pose.yaw)
        for k, o in zip(self._disc_numbers, self._disc_obstacles, strict=True):
            self.air[k] = min(self.air[k], clearance(x, y, pose.yaw, o, self.path, motion.t))
            if self.air[k] < 0.0 and not self.why:
                self.why = f"the car is at obstacle {k + 1}"

    def _reach(self, disc: Disc) -> float:
        """Return the distance [m] from the path within which a disc reduces the lane."""
        return self.mpcc.limits.lane + disc.radius + HALF_WIDTH + LATERAL_MARGIN

    def _hold_steering(self, motion: MotionEstimate) -> float:
        """Return the angle [rad] of the current command and record it."""
        low, high = self.plant.lock
        angle = min(max(self.plant.angle_of(self._st), low), high)
        self._prediction.record_command(motion.t, angle)
        return angle

    def _make_plan(self, motion: MotionEstimate) -> MpcPlan:
        """Plan from the time at which the inputs act; set ``why`` if the plan cannot be driven."""
        future, s = self._predict_motion(motion, self.plant.delay.transport)
        last_plan = self.plan
        tau = float(last_plan.state_at(future.t)[6]) if last_plan else self.mpcc.limits.tau[0]
        effective = self._disturbance.effective
        state = make_first_state(
            self.plant, future, self._vehicle.body.l_r, tau, effective(future.servo)
        )
        last_tau = float(last_plan.inputs[0, 0]) if last_plan else tau
        low, high = self.mpcc.limits.st
        self.mpcc.set_steering_range(effective(low), effective(high))
        plan: MpcPlan = self.mpcc.plan(future.t, state, s, (last_tau, effective(self._st)))
        self._late_plans = self._late_plans + 1 if plan.outcome is PlanOutcome.LATE else 0
        self.why = describe_failure(plan.outcome, self._late_plans)
        if self.why and last_plan is not None:
            self._last_course = self._find_course(last_plan)
        return plan

    def _find_course(self, plan: MpcPlan) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return arc length [m], offset [m] and heading error [rad] of the states of a plan."""
        course = []
        s = self.s
        for x, y, yaw in plan.states[:, :3].tolist():
            s = self.path.closest(x, y, s)
            turn = yaw - self.path.interpolate(s).heading
            course.append((s, self.path.offset(x, y, s), remainder(turn, 2.0 * pi)))
        s_values, offsets, turns = np.array(course).T
        return s_values, offsets, turns

    def _steer_by_fallback(self, motion: MotionEstimate) -> float:
        """Steer along the last plan: the fallback gets the motion relative to it."""
        offset, turn = (float(np.interp(self.s, self._last_course[0], values))
                        for values in self._last_course[1:])
        heading = self.path.interpolate(self.s).heading
        pose = motion.pose
        relative = replace(pose, x=pose.x + offset * sin(heading), y=pose.y - offset * cos(heading),
                           yaw=pose.yaw - turn)
        return self._fallback.steer(replace(motion, pose=relative))

    def _target_speeds(self, s: FloatArray) -> FloatArray:
        """Return the target speeds [m/s] at arc lengths [m]."""
        return np.array([self.pace(float(one)) for one in s])


def _check_passable(k: int, disc: Disc, o: Obstacle, lane: float) -> None:
    """Raise UsageError for an obstacle that no plan passes within the lane."""
    needed_width = required_offset(o) + OBSTACLE_LANE_MARGIN
    if needed_width > lane:
        side = "left" if o.offset > 0.0 else "right"
        raise UsageError(
            f"obstacle {k} leaves no passage within the lane",
            found=f"{abs(o.offset):.2f} m to the {side} of the path at {o.s:.2f} m, radius "
                  f"{disc.radius:g} m: the car would need an offset of {required_offset(o):.2f} m"
                  " from the path",
            expected=f"{OBSTACLE_LANE_MARGIN:g} m less than the lane of {lane:g} m to either side",
            remedy=f"--lane {needed_width + 0.005:.2f} if there is space, or move the obstacle")


def _limits(plant: Plant) -> MpcLimits:
    """Return the limits of the car: dead band, stops, throttle, brake; tyres by the model."""
    ends = np.abs(plant.steady.tyre_limits) * SPEEDS**2
    return MpcLimits(*input_ranges(plant), lateral=TYRE_SHARE * float(ends.max(axis=1).min()),
                     brake=brake_range(plant))
